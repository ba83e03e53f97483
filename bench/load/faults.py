"""Faults: faults are injected into a service at random moments; it must lose nothing.

After each round and at the end, these conditions hold: each acknowledged fold exists and ends; a
verified fold is complete; its result, figures and plan never change; no files of broken uploads
remain. The moments are drawn from a seed, which the output reports.
"""

from __future__ import annotations

import json
import random
import shutil
import signal
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

import psutil

from bench.load.site import ONE_MACHINE, NotReadyError, Setup, Site
from bench.load.witness import Witness
from bench.sections import Section
from foldback.planner.progress import STAGES
from tests.server.service_process import SNAKE

OUT: Final = Path("out/load")
"""Directory of the data and logs of a run; a run without errors deletes its own."""
FOLDS_TIMEOUT_S: Final = 240.0
"""Maximum time in which all folds must end after a fault, such as a killed process or a full disk,
in s; beyond it the fault test fails."""
SHAPES: Final = ("wrench-24", "wrench-24", "wrench-80", "tetra-ring", None)
"""Shapes of the requested folds, drawn with equal weight; None is an uploaded path of 16
modules."""
FAULTS_SEED: Final = 7
"""Default random seed of the order of the faults, of their moments and of the requested folds.
Another value tests another sequence; it is printed, so that a failed run can be repeated."""

Fault = Callable[["Driver"], None]


class Driver:
    """Client that sends folds to a site and injects faults; a witness watches the folds."""

    def __init__(self, site: Site, seed: int) -> None:
        self.site = site
        self.rng = random.Random(seed)
        self.witness = Witness(lambda: site.address)
        self.sent = 0
        self.answers: Counter[int] = Counter()

    def submit(self, count: int) -> None:
        """Request folds, each with a seed of its own."""
        for _ in range(count):
            self.sent += 1
            shape = self.rng.choice(SHAPES)
            form = {"seed": str(self.sent)} if shape is None else self._form(shape)
            files = None if shape else {"file": ("path.json", json.dumps(SNAKE))}
            answer = self.site.answer("POST", "/api/folds", data=form, files=files)
            if answer is None:
                continue
            self.answers[answer.status_code] += 1
            if answer.status_code == 202:
                self.witness.acknowledged(answer.json()["id"])

    def _form(self, shape: str) -> dict[str, str]:
        return {"shape": shape, "seed": str(self.sent)}

    def moment(self) -> None:
        """Wait for a random time, or until a fold is in a random stage."""
        if self.rng.random() < 0.4:
            time.sleep(self.rng.uniform(0, 2.5))
            return
        stage = self.rng.choice(STAGES)
        until = time.monotonic() + 3.0
        while time.monotonic() < until:
            for fold in self.witness.waiting():
                answer = self.site.answer("GET", f"/api/folds/{fold.id}")
                if answer is not None and answer.status_code == 200:
                    state = answer.json()
                    if state["status"] == "running" and state["stage"] == stage:
                        time.sleep(self.rng.uniform(0, 0.1))
                        return
            time.sleep(0.01)

    def one(self, kind: str) -> psutil.Process | None:
        """Return a random process of a kind; None if there is none."""
        processes = self.site.processes(kind)
        return self.rng.choice(processes) if processes else None

    def settle(self) -> None:
        """Wait until all folds have ended and the witness has checked them.

        Raises:
            AssertionError: If a fold does not end, or the witness found a problem.
        """
        deadline = time.monotonic() + FOLDS_TIMEOUT_S
        while waiting := self.witness.waiting():
            assert not self.witness.problems, "\n".join(self.witness.problems)
            stuck = ", ".join(f"{s.id} {s.statuses} after {sorted(s.faults)}" for s in waiting)
            assert time.monotonic() < deadline, f"does not come to an end: {stuck}"
            time.sleep(0.05)


def worker_killed(driver: Driver) -> None:
    if (worker := driver.one("worker")) is not None:
        worker.kill()


def server_killed(driver: Driver) -> None:
    driver.site.kill_web()


def everything_killed(driver: Driver) -> None:
    driver.site.kill_everything()


def child_killed(driver: Driver) -> None:
    """Kill a child process, as the kernel does when memory is exhausted."""
    if (child := driver.one("stages")) is not None:
        child.kill()


def worker_stopped(driver: Driver) -> None:
    """Suspend a worker for longer than its lease, then let it continue.

    Its children are suspended too in half of the cases, as on a frozen machine.
    """
    worker = driver.one("worker")
    if worker is None:
        return
    with suppress(psutil.Error):
        frozen = [worker, *(worker.children() if driver.rng.random() < 0.5 else [])]
        for process in frozen:
            process.suspend()
        time.sleep(driver.rng.uniform(2.5, 6.0))
        for process in frozen:
            process.resume()


def upload_cut(driver: Driver) -> None:
    """Kill the web process while uploads are half sent and others are being accepted."""
    body = json.dumps([[x, 0, 0] for x in range(30_000)]).encode()
    halves = [_half(driver.site.address, body) for _ in range(3)]
    stopping = threading.Event()

    def keep_sending() -> None:
        while not stopping.is_set():
            driver.submit(1)

    sender = threading.Thread(target=keep_sending)
    sender.start()
    time.sleep(driver.rng.uniform(0, 0.3))
    driver.site.kill_web()
    stopping.set()
    sender.join()
    for half in halves:
        half.close()


def _half(address: str, body: bytes) -> socket.socket:
    at = urlsplit(address)
    assert at.hostname is not None
    upload = socket.create_connection((at.hostname, at.port or 80), timeout=10)
    head = (
        b'--cut\r\nContent-Disposition: form-data; name="file"; filename="long.json"\r\n\r\n' + body
    )
    upload.sendall(
        f"POST /api/folds HTTP/1.1\r\nHost: {at.netloc}\r\nContent-Length: {len(head) + 11}\r\n"
        "Content-Type: multipart/form-data; boundary=cut\r\n\r\n".encode()
        + head[: len(head) // 2]
    )
    return upload


def restarted(driver: Driver) -> None:
    """Shut the service down gracefully."""
    driver.site.end()


def disk_full(driver: Driver) -> None:
    driver.site.disk.fill()
    _broken_storage(driver, "the disk was full")
    driver.site.disk.free()
    _mended(driver)


def disk_failed(driver: Driver) -> None:
    """Make the disk read-only; then restart everything on the repaired disk."""
    if not driver.site.disk.real:
        driver.site.kill_everything()
    # On Linux 6.18, fdatasync of ext4 may report success if the journal is aborted meanwhile, and
    # the data are then lost: in 11 of 60 failures while four programs appended to files, and in 0
    # of 60 while they were paused. No program can survive that, and a power cut does not do it.
    with driver.site.paused():
        driver.site.disk.fail()
    _broken_storage(driver, "the disk was read-only")
    driver.witness.condition = "the disk was read-only"
    driver.site.kill_everything()
    driver.site.disk.come_back()
    _mended(driver)


def _broken_storage(driver: Driver, condition: str) -> None:
    driver.witness.condition = condition
    driver.submit(1)
    time.sleep(driver.rng.uniform(0.5, 2.5))
    driver.submit(1)


def _mended(driver: Driver) -> None:
    time.sleep(1.0)  # pending requests are answered
    driver.witness.condition = ""


def clock_jumped(driver: Driver) -> None:
    driver.site.clock.set(driver.rng.randint(-9, 9) * 3600 + driver.rng.randint(-1800, 1800))


def _outage(driver: Driver, name: str) -> None:
    """Make a shared service (database or storage) unresponsive for a while."""
    driver.witness.condition = f"during {name}"
    with driver.site.setup.outages[name]():
        _broken_storage(driver, f"during {name}")
    _mended(driver)


FAULTS: Final[Mapping[str, Fault]] = {
    "worker killed": worker_killed,
    "server killed": server_killed,
    "everything killed": everything_killed,
    "child killed": child_killed,
    "worker stopped": worker_stopped,
    "upload cut": upload_cut,
    "restarted": restarted,
    "disk full": disk_full,
    "disk failed": disk_failed,
    "clock jumped": clock_jumped,
}
ALLOWED_CODES: Final[Mapping[str, frozenset[str]]] = {
    "child killed": frozenset({"crashed"}),
    "disk full": frozenset({"disk-full"}),
    "disk failed": frozenset({"disk-full", "disk-failed"}),
}
"""Error codes with which a fold may fail, by fault; after all other faults it must succeed."""


@dataclass(slots=True, kw_only=True)
class _Outcome:
    """Course and result of a run.

    Attributes:
        rounds: Number of rounds that were requested.
        seed: Seed of all random choices.
        place: Directory of the data and logs.
        happened: Number of injected faults, by name.
        harmed: Number of folds in progress at these faults, by name.
        broken: Reason why the run ended early; None if it was completed.
        orphans: Number of fold directories whose ids no client has received.
    """

    rounds: int
    seed: int
    place: Path
    happened: Counter[str] = field(default_factory=Counter[str])
    harmed: Counter[str] = field(default_factory=Counter[str])
    broken: str | None = None
    orphans: int = 0


def faults(
    rounds: int = 120,
    *,
    seed: int = FAULTS_SEED,
    setup: Setup = ONE_MACHINE,
    only: tuple[str, ...] = tuple(FAULTS),
) -> Section:
    """Inject one fault into a service per round.

    Args:
        rounds: Number of rounds, each with one fault.
        seed: Seed of all random choices.
        setup: Layout of the service.
        only: Names of the faults; all of them are drawn equally often.
    """
    section = Section(name=f"faults, {setup.name}")
    place = (OUT / f"faults-{time.strftime('%H%M%S')}-{seed}").absolute()
    site = Site(place, setup)
    driver = Driver(site, seed)
    outcome = _Outcome(rounds=rounds, seed=seed, place=place)
    start_s = time.monotonic()
    try:
        site.up()
        names: list[str] = []
        for number in range(rounds):
            if not names:
                names = list(only)
                driver.rng.shuffle(names)
            name = names.pop()
            _round(driver, name, outcome)
            # A third of the faults occur while the service still recovers from the previous one.
            if driver.rng.random() < 0.67 or number == rounds - 1:
                driver.settle()
                assert site.left_uploads() == [], f"left of uploads: {site.left_uploads()}"
            print(f"round {number + 1} of {rounds}: {name}, {time.monotonic() - start_s:.0f} s")
            assert not driver.witness.problems, "\n".join(driver.witness.problems)
        driver.settle()
        driver.submit(1)
        driver.settle()
        driver.witness.close()
        driver.witness.look_again()
        site.end()
        assert not site.processes(), f"goes on after the end: {site.processes()}"
    except (AssertionError, NotReadyError) as error:
        outcome.broken = str(error)
    except KeyboardInterrupt:
        outcome.broken = "stopped before its end"
    finally:
        if driver.witness._thread.is_alive():
            driver.witness.close()
        outcome.orphans = _orphans(site, driver)
        site.close()
    _tell(section, driver, outcome)
    if all(figure.met is not False for figure in section.figures):
        shutil.rmtree(place)
    return section


def _round(driver: Driver, name: str, outcome: _Outcome) -> None:
    driver.submit(driver.rng.randint(1, 2))
    driver.moment()
    before = len(driver.witness.waiting())
    driver.witness.happens(name)
    if name in FAULTS:
        FAULTS[name](driver)
    else:
        _outage(driver, name)
    driver.witness.happens(name)  # also for folds that were accepted in the meantime
    outcome.happened[name] += 1
    outcome.harmed[name] += before
    driver.site.up()


def _orphans(site: Site, driver: Driver) -> int:
    """Return the number of fold directories whose ids no client has received."""
    folder = site.data_dir / "folds"
    names = {path.name for path in folder.iterdir()} if folder.exists() else set[str]()
    return len(names - set(driver.witness.folds))


def _tell(section: Section, driver: Driver, outcome: _Outcome) -> None:
    witness, happened, broken = driver.witness, outcome.happened, outcome.broken
    folds = list(witness.folds.values())
    ends: Counter[str] = Counter()
    unclear: list[str] = []
    for fold in folds:
        end = fold.end or {"status": "not over", "error": None}
        word = (end["error"] or {}).get("code")
        ends[f"{end['status']}{f', {word}' if word else ''}"] += 1
        allowed = frozenset().union(
            *(ALLOWED_CODES.get(fault, frozenset()) for fault in fold.faults)
        )
        if end["status"] != "verified" and word not in allowed:
            unclear.append(f"{fold.id}: {end} after {sorted(fold.faults)}")
    for name in sorted(happened):
        section.rows.append(
            {"fault": name, "times": happened[name], "folds under way": outcome.harmed[name]}
        )
    lost = [problem for problem in witness.problems if "is lost" in problem]
    twice = [p for p in witness.problems if "twice" in p or "goes on" in p or "changed" in p]
    unexpected = [p for p in witness.problems if p not in lost and p not in twice]
    section.add(
        "faults", f"{happened.total()}, seed {outcome.seed}", f"≥ {outcome.rounds}", not broken
    )
    section.add("folds acknowledged", f"{len(folds)}; {dict(ends)}")
    section.add("lost", str(len(lost)), "0", not lost)
    section.add("half-shown", str(len(unexpected)), "0", not unexpected)
    section.add("done twice", str(len(twice)), "0", not twice)
    section.add("failed without a word that fits", str(len(unclear)), "0", not unclear)
    section.add("looks at folds", f"{witness.looks}; failed: {dict(witness.errors)}")
    section.add("answers to uploads", f"{dict(sorted(driver.answers.items()))}")
    section.add("directories that no visitor was told of", str(outcome.orphans))
    for text in [*([broken] if broken else []), *witness.problems, *unclear]:
        section.add("what went wrong", f"{text} (see {outcome.place})", "", False)


def signals() -> None:
    """Handle SIGTERM as Ctrl-C, so that the disk is unmounted."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
