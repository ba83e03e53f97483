"""A new user's first minutes: from a fresh clone to a verified fold of the user's own shape."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import httpx
import psutil
from playwright.sync_api import Page, sync_playwright

from bench.page_speed import HERO, MOVING
from bench.sections import Section
from tests.browser.conftest import FLAGS
from tests.tools import CHROMIUM

ROOT: Final = Path(__file__).parents[1]
OWN_SHAPE: Final = ROOT / "examples" / "shapes" / "wrench-24.json"
"""Chain of 24 cubes that is uploaded under another name, so that no finished fold is reused."""
PORT: Final = "18099"
"""TCP port of the service. To be free on most machines."""
FIRST_MINUTES_TIMEOUT_S: Final = 900.0
"""Maximum time that the benchmark of a fresh installation waits for each of its events, such as the
first motion on the landing page, in s; beyond it the benchmark ends with an error."""
STATUS_POLL_S: Final = 0.2
"""Time between two requests for the state of the service or of a fold, in s. The measured times are
too long by up to this value."""


class _Watch:
    """Wall time since the start, and processor time of a process and its descendants."""

    def __init__(self, process: psutil.Process) -> None:
        self._process = process
        self._spent: dict[tuple[int, float], float] = {}
        self._began = time.monotonic()

    def seconds(self) -> tuple[float, float]:
        """Return wall and processor seconds so far; ended processes count as last measured."""
        with psutil.Process().oneshot():
            family = [self._process, *self._process.children(recursive=True)]
        for member in family:
            try:
                used = member.cpu_times()
                processor_s = used.user + used.system + used.children_user + used.children_system
                # Running children count by themselves: the parent's times omit them.
                self._spent[member.pid, member.create_time()] = processor_s
            except psutil.Error:
                continue
        return time.monotonic() - self._began, sum(self._spent.values())


def first_minutes(reference_seconds: float) -> Section:
    """Clone, install, start the service, open its pages, and fold 24 cubes."""
    del reference_seconds
    section = Section(name="first")
    with tempfile.TemporaryDirectory(prefix="foldback-first-") as folder:
        clone = Path(folder) / "foldback"
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
        wall, cpu = _installed(clone)
        _add(section, "installation", wall, cpu)
        usage = subprocess.run(
            ["du", "-sm", clone / ".venv"], check=True, capture_output=True, text=True
        )
        size = int(usage.stdout.split()[0])
        section.add("size of the environment, du -sm", f"{size} MB", "≤ 430 MB", size <= 430)
        with _serving(clone, Path(folder)) as (watch, address):
            _watched(section, watch, address)
    for name, bar_s in (("address printed", 20), ("own fold of 24 cubes verified", 26)):
        seconds = wall + next(row["wall_s"] for row in section.rows if row["what"] == name)
        title = f"from an empty folder: {name}"
        section.add(title, f"{seconds:.1f} s", f"≤ {bar_s} s", seconds <= bar_s)
    return section


def _add(section: Section, name: str, wall: float, cpu: float) -> None:
    section.rows.append({"what": name, "wall_s": wall, "processor_s": cpu})
    section.add(name, f"{wall:.1f} s, {cpu:.1f} s of the processor")


def _installed(clone: Path) -> tuple[float, float]:
    """Install as `make run` does; return wall seconds and processor seconds."""
    began, before = time.monotonic(), os.times()
    subprocess.run(["make", "--silent", ".venv/.runs"], cwd=clone, check=True, env=_environment())
    after = os.times()
    cpu = after.children_user + after.children_system - before.children_user
    return time.monotonic() - began, cpu - before.children_system


def _environment() -> dict[str, str]:
    """Return an environment without this project's own settings."""
    dropped = ("FOLDBACK_", "PYTHONPATH", "VIRTUAL_ENV", "MAKE", "MFLAGS")
    return {k: v for k, v in os.environ.items() if not k.startswith(dropped)}


@contextmanager
def _serving(clone: Path, folder: Path) -> Generator[tuple[_Watch, str]]:
    """Run the service of a clone on an empty data directory until the context ends."""
    settings = {"FOLDBACK_PORT": PORT, "FOLDBACK_DATA_DIR": str(folder / "data")}
    process = subprocess.Popen(
        ["make", "--silent", "run"],
        cwd=clone,
        env={**_environment(), **settings},
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        watch = _Watch(psutil.Process(process.pid))
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith("foldback is at "):
                yield watch, line.removeprefix("foldback is at ").strip()
                return
        raise RuntimeError(f"the service ended with {process.wait()} before it was ready.")
    finally:
        for child in psutil.Process(process.pid).children(recursive=True):
            child.send_signal(signal.SIGTERM)
        process.wait(60)


def _watched(section: Section, watch: _Watch, address: str) -> None:
    _add(section, "address printed", *watch.seconds())
    with sync_playwright() as playwright, httpx.Client(base_url=address, timeout=120) as http:
        browser = playwright.chromium.launch(executable_path=CHROMIUM.get(), args=FLAGS)
        page = browser.new_page()
        page.goto(address)
        _add(section, "page complete", *watch.seconds())
        page.wait_for_function(HERO, timeout=1000 * FIRST_MINUTES_TIMEOUT_S)
        _add(section, "first motion, on the first page", *watch.seconds())
        finished = http.get("/api/folds").json()["folds"]
        section.add("finished folds", str(len(finished)), "5", len(finished) == 5)
        _open_finished(section, page, f"{address}{finished[-1]['links']['page']}", watch)
        browser.close()
        own_fold = _own_fold(http)
        _wait_over(http, own_fold, watch)
        _add(section, "own fold of 24 cubes verified", *watch.seconds())


def _open_finished(section: Section, page: Page, address: str, watch: _Watch) -> None:
    page.goto(address)
    page.wait_for_function(MOVING, timeout=1000 * FIRST_MINUTES_TIMEOUT_S)
    _add(section, "a finished fold in motion", *watch.seconds())


def _own_fold(http: httpx.Client) -> str:
    """Request a fold of the user's own shape; return its id."""
    shape = json.loads(OWN_SHAPE.read_bytes()) | {"name": "my own"}
    answer = http.post("/api/folds", files={"file": ("own.json", json.dumps(shape))})
    answer.raise_for_status()
    return answer.json()["id"]


def _wait_over(http: httpx.Client, fold: str, watch: _Watch) -> None:
    deadline = time.monotonic() + FIRST_MINUTES_TIMEOUT_S
    while (status := http.get(f"/api/folds/{fold}").json()["status"]) != "verified":
        if status in ("failed", "cancelled") or time.monotonic() > deadline:
            raise RuntimeError(f"got the status {status}, expected verified.")
        watch.seconds()
        time.sleep(STATUS_POLL_S)
