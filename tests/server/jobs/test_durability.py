"""Durability: accepted folds are finished, whichever processes are killed meanwhile."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
import pytest

from planner.errors import TimelineError
from planner.file_names import TIMELINE
from planner.motion.timeline import Timeline
from planner.pipeline.fold_layout import last_frame, result
from planner.plan.plan import Plan
from planner.progress import STAGES
from server.api.schemas import PAUSED_MESSAGE
from server.jobs import execution
from server.jobs.execution import Execution, PausedError
from server.jobs.queue import MAX_LOSSES, FoldClaim
from server.jobs.runner import Runner
from server.jobs.slices import Slice
from server.processes.children import Child, ChildError
from server.processes.fork_server import ForkServer
from server.store.folds import Store
from tests.server.here import FORKS, ServiceHere
from tests.server.processes.test_fork_server import before_others
from tests.server.service import PATIENCE_S, SNAKE, STAIRS, Service, over

pytestmark = pytest.mark.slow
HereWith = Callable[..., ServiceHere]


def check_finished(service: Service, fold_id: str) -> None:
    state = service.wait_over(fold_id)
    assert state["status"] == "verified", state
    body = service.http.get(f"/api/folds/{fold_id}/frames?stride=10").json()
    assert body["status"] == "complete"
    assert body["time_s"] == sorted(body["time_s"])
    assert service.http.get(f"/api/folds/{fold_id}/plan.json").status_code == 200


@pytest.mark.long
def test_fold_of_a_killed_worker_is_finished_by_its_successor(service_with) -> None:
    service = service_with().start()
    fold_id = service.fold(shape="wrench-160")["id"]
    waiting = service.fold(SNAKE)["id"]
    assert service.wait_exploding(fold_id)["status"] == "running"
    (worker,) = service.processes("server.jobs.worker")
    worker.kill()
    check_finished(service, fold_id)
    check_finished(service, waiting)
    (successor,) = service.processes("server.jobs.worker")
    assert successor.pid != worker.pid


@pytest.mark.long
def test_fold_of_a_killed_service_is_finished_by_the_next(service_with) -> None:
    service = service_with()
    with ServiceHere(service.data_dir).start() as taking_in:
        # A smaller one may be over before its explosion has been seen.
        fold_id = taking_in.fold(shape="wrench-160", settings="robots=0")["id"]
        waiting = taking_in.fold(SNAKE)["id"]
    service.start()
    assert service.wait_exploding(fold_id)["status"] == "running"
    read = service.directory(fold_id) / "candidates.json"
    made = read.stat().st_mtime_ns
    service.kill()
    with ServiceHere(service.data_dir).start() as again:
        assert again.state(fold_id)["status"] == "running"
        with again.worker():
            check_finished(again, fold_id)
            check_finished(again, waiting)
    assert read.stat().st_mtime_ns == made, "a step that was completed was repeated"


@pytest.mark.long
def test_stopped_service_keeps_its_fold_for_the_next_start(service_with) -> None:
    service = service_with().start()
    fold_id = service.fold(shape="wrench-160")["id"]
    assert service.wait_exploding(fold_id)["status"] == "running"
    followers = service.events(fold_id)
    assert next(followers)[0] == "progress"
    service.process.terminate()
    assert "done" not in [name for name, _ in followers]  # let go, in good order
    assert service.stop() == 0
    assert "Traceback" not in service.log.read_text()
    service.start()
    check_finished(service, fold_id)


@contextmanager
def running(
    service: ServiceHere, claim: FoldClaim, *, fork_server: ForkServer = FORKS
) -> Iterator[tuple[Store, Execution]]:
    """What a worker runs a fold with; its stages are computed in a child, as everywhere."""
    with closing(Store(service.settings)) as store:
        runner = Runner(service.settings, store, fork_server=fork_server)
        try:
            yield store, runner.execution(claim)
        finally:
            runner.stop()


def compute(
    service: ServiceHere, fold_id: str, *, fork_server: ForkServer = FORKS, losses: int = 0
) -> dict[str, Any]:
    """Does what a worker does with a fold, and tells how it stands then."""
    claim = FoldClaim(fold_id, "tests", STAGES[0], files=0, losses=losses)
    with running(service, claim, fork_server=fork_server) as (_, execution):
        execution.run()
    return service.state(fold_id)


HELD = """
import os, sys, time
from pathlib import Path
if "server.processes.forking" in sys.orig_argv and Path({!r}).exists():
    from planner.motion.timeline import TimelineWriter
    flush, server = TimelineWriter.flush, os.getpid()

    def held(self):
        flush(self)
        while len(self) and os.getpid() != server:
            time.sleep(1)

    TimelineWriter.flush = held
"""
"""Has a child stop for good once it has recorded motion, as long as a file is there."""


@dataclass(frozen=True)
class Held:
    """A fork server whose children stop once they have recorded motion.

    Attributes:
        server: The fork server.
        hold: Children of a fork server that starts without this file do not stop.
    """

    server: ForkServer
    hold: Path

    def kill_child(self, directory: Path, killed: dict[int, str]) -> None:
        """Wait for a child that has recorded motion of a fold and was not killed yet; kill it."""
        process = self.child(directory, killed)
        recorded = recorded_id(directory)
        assert recorded is not None
        killed[process.pid] = recorded
        process.kill()

    def child(self, directory: Path, killed: dict[int, str]) -> psutil.Process:
        """Wait for a child that has recorded motion of a fold, and return it."""
        deadline = time.monotonic() + PATIENCE_S
        while True:
            for process in psutil.Process(self.server.pid).children():
                recorded = recorded_id(directory)
                if process.pid not in killed and recorded not in (None, *killed.values()):
                    return process
            assert time.monotonic() < deadline, f"killed {killed}"
            time.sleep(0.02)


def recorded_id(directory: Path) -> str | None:
    """Return the identity of a fold's timeline that has a frame; each child makes its own."""
    timeline = result(directory, TIMELINE)
    with suppress(TimelineError):
        return Timeline.open(timeline).id if last_frame(timeline) is not None else None
    return None


@pytest.fixture(scope="module")
def forks(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Held]:
    code = tmp_path_factory.mktemp("held") / "code"
    hold = code.parent / "hold"
    code.mkdir()
    (code / "sitecustomize.py").write_text(HELD.format(str(hold)))
    environment = {"PYTHONPATH": before_others(code)}
    hold.touch()
    with closing(ForkServer(["stages"], warm=False, environment=environment)) as server:
        server.start()
        yield Held(server, hold)


@pytest.fixture
def held(forks: Held, monkeypatch: pytest.MonkeyPatch) -> Held:
    """The fork server; a fold fails when its process has died twice."""
    monkeypatch.setattr(execution, "MAX_CRASHES", 2)
    return forks


def test_fold_whose_process_dies_repeatedly_fails_alone(here_with: HereWith, held: Held) -> None:
    service = here_with().start()
    options = {"strategy": "simultaneous"}
    accepted = service.fold(STAIRS, **options)
    directory, killed = service.directory(accepted["id"]), dict[int, str]()
    with ThreadPoolExecutor(1) as worker:
        computing = worker.submit(compute, service, accepted["id"], fork_server=held.server)
        for _ in range(2):
            held.kill_child(directory, killed)
        state = computing.result()
    assert (state["status"], state["error"]["code"]) == ("failed", "crashed")
    for words in ("SIGKILL", "happened 2 times"):
        assert words in state["error"]["detail"]
    # What was there of it stays, and tells where it was.
    assert state["summary"]["stuck"]["kind"] == "stopped"
    assert Timeline.open(directory / "timeline.zarr").status == "failed"
    # It was the machine's fault, not the shape's: asked for again it is computed again.
    again = service.fold(STAIRS, token=accepted["owner_token"], **options)
    assert not again["existing"] and again["id"] != accepted["id"]


def test_fold_goes_on_when_its_process_or_fork_server_is_killed(
    here_with: HereWith, held: Held
) -> None:
    service = here_with().start()
    fold_id = service.fold(STAIRS, strategy="simultaneous")["id"]
    directory, killed = service.directory(fold_id), dict[int, str]()
    with ThreadPoolExecutor(1) as worker:
        computing = worker.submit(compute, service, fold_id, fork_server=held.server)
        for _ in range(1):
            held.kill_child(directory, killed)
        held.child(directory, killed)
        held.hold.unlink()
        psutil.Process(held.server.pid).kill()
        assert computing.result()["status"] == "verified"
    check_finished(service, fold_id)
    held.hold.touch()
    psutil.Process(held.server.pid).kill()  # so that the next one holds its children again


@pytest.mark.long
def test_fold_makes_room_for_a_cheaper_one_and_goes_on(
    service_with: Callable[..., Service],
) -> None:
    service = service_with(slice_seconds=0.2).start()
    long = service.fold(shape="wrench-160", settings="robots=0")["id"]
    service.wait_exploding(long)
    short = service.fold(STAIRS)["id"]
    paused = service.wait(long, lambda state: state["progress"]["paused"] or over(state))
    assert paused["status"] == "queued" and paused["stage"] in STAGES, paused
    assert paused["progress"]["message"] == PAUSED_MESSAGE
    check_finished(service, short)
    check_finished(service, long)


def test_fold_beyond_its_time_limit_fails(here_with: HereWith) -> None:
    service = here_with(stage_seconds=0.2).start()
    state = compute(service, service.fold(shape="wrench-160", settings="robots=0")["id"])
    assert (state["status"], state["error"]["code"]) == ("failed", "time-limit")
    assert "0.2 s" in state["error"]["detail"]


@pytest.mark.long
def test_verified_plan_is_kept_when_the_search_for_a_better_one_fails(
    here_with: HereWith, monkeypatch: pytest.MonkeyPatch
) -> None:
    call, calls = Child.call, list[str]()

    def cut_off(self: Child, stage: str, directory: Path, **more: Any) -> dict[str, Any]:
        calls.append(stage)
        if stage == "explode" and calls.count(stage) == 2:
            raise ChildError("time-limit", "the stage 'explode' took longer than it may")
        return call(self, stage, directory, **more)

    monkeypatch.setattr(Child, "call", cut_off)
    service = here_with().start()
    state = compute(service, service.fold(STAIRS, prefer="time")["id"])
    assert calls[-5:] == ["explode", "play_back", "certify", "explode", "export"]
    assert (state["status"], state["error"]) == ("verified", None)
    plan = Plan.load(service.directory(state["id"]) / "plan.npz")
    assert [a.get("chosen", False) for a in plan.attempts] == [True]


@pytest.mark.parametrize(
    "stage",
    [pytest.param(s, marks=[pytest.mark.long] * (s not in ("explode", "export"))) for s in STAGES],
)
def test_result_of_a_paused_stage_is_not_kept(
    here_with: HereWith, monkeypatch: pytest.MonkeyPatch, stage: str
) -> None:
    call = Child.call

    def cut_off(self: Child, name: str, directory: Path, **more: Any) -> dict[str, Any]:
        if name == stage and more["cancelled"]():
            return {"status": "failed", "reason": "it was cancelled", "again": None}
        return call(self, name, directory, **more)

    monkeypatch.setattr(Child, "call", cut_off)
    monkeypatch.setattr(Slice, "over", lambda part: setattr(part, "ended", True) or True)
    service = here_with().start()
    fold_id = service.fold(STAIRS)["id"]
    claim = FoldClaim(fold_id, "one", stage, files=1, losses=0)
    with running(service, claim) as (store, execution):
        with pytest.raises(PausedError):
            execution.run()
        row = store.fold(fold_id)
        assert (row.checkpoint, row.status, row.pauses) == (None, "queued", 1)


def test_fold_beyond_its_memory_limit_is_refused(here_with: HereWith) -> None:
    service = here_with(child_memory_bytes=128 * 2**20).start()
    cells = [[x, 0, 0] for x in range(3000)]
    answer = service.http.post("/api/folds", files={"file": ("long.json", str(cells))})
    if answer.status_code == 202:
        state = compute(service, answer.json()["id"])
        assert (state["status"], state["error"]["code"]) == ("failed", "memory-limit")
        assert "128 MiB" in state["error"]["detail"]
    else:
        assert answer.status_code == 422
        assert "128 MiB" in answer.json()["detail"]
    assert service.http.get("/health").status_code == 200


def test_fold_lost_with_its_workers_repeatedly_fails(here_with: HereWith) -> None:
    service = here_with().start()
    state = compute(service, service.fold(SNAKE)["id"], losses=MAX_LOSSES)
    assert (state["status"], state["error"]["code"]) == ("failed", "internal")


def test_unfinished_upload_of_an_ended_service_is_removed(here_with: HereWith) -> None:
    service = here_with()
    left = service.data_dir / "uploads" / "halfway"
    left.mkdir(parents=True)
    (left / "input").write_bytes(b"[[0,0,0],")
    service.start()
    assert not left.exists()
    assert service.http.get("/api/folds").json() == {"folds": []}
