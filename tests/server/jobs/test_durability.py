"""Durability: accepted folds are finished even if the processes that compute them are killed.

tests/bench/test_load.py kills processes at random moments.
"""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

from foldback.planner.motion.timeline import Timeline, TimelineWriter
from foldback.planner.pipeline.fold_layout import result_path
from foldback.planner.plan.plan import Plan
from foldback.planner.progress import STAGES
from foldback.planner.storage.file_names import TIMELINE
from foldback.server.jobs import execution
from foldback.server.jobs.execution import Execution, PausedError
from foldback.server.jobs.queue import MAX_LOSSES, FoldClaim
from foldback.server.jobs.runner import Runner
from foldback.server.jobs.slices import Slice
from foldback.server.processes.children import CRASHED, LOST, Child, ChildError
from foldback.server.schemas import PAUSED_MESSAGE
from foldback.server.store.folds import Store
from tests.server.service_process import SNAKE, STAIRS, Service, over
from tests.server.service_thread import ServiceThread, ServiceWith

pytestmark = pytest.mark.slow


def check_finished(service: Service, fold_id: str) -> bytes:
    """Check that a fold is verified and complete, and return its plan."""
    state = service.wait_over(fold_id)
    assert state["status"] == "verified", state
    body = service.http.get(f"/api/folds/{fold_id}/frames?stride=10").json()
    assert body["status"] == "complete", body["detail"]
    assert body["time_s"] == sorted(body["time_s"])
    assert service.http.get(f"/api/folds/{fold_id}/plan.json").status_code == 200
    return service.http.get(f"/api/folds/{fold_id}/plan.npz").raise_for_status().content


@contextmanager
def running_fold(service: ServiceThread, claim: FoldClaim) -> Iterator[tuple[Store, Execution]]:
    """Yield the store and execution of a worker's fold; its stages run in a child, as usual."""
    with closing(Store(service.settings)) as store:
        runner = Runner(service.settings, store)
        try:
            yield store, runner.execution(claim)
        finally:
            runner.stop()


def compute(service: ServiceThread, fold_id: str, *, losses: int = 0) -> dict[str, Any]:
    """Compute a fold as a worker does, and return its state."""
    claim = FoldClaim(fold_id, "tests", STAGES[0], files=0, losses=losses)
    with running_fold(service, claim) as (_, execution):
        execution.run()
    return service.state(fold_id)


def crash_after(monkeypatch: pytest.MonkeyPatch, *codes: str) -> None:
    """Let children end with these codes, one after the other, after they have recorded motion."""
    call, remaining_codes = Child.call, list(codes)

    def crash(self: Child, stage: str, directory: Path, **extra: Any) -> dict[str, Any]:
        stage_result = call(self, stage, directory, **extra)
        if stage != "explode" or not remaining_codes:
            return stage_result
        TimelineWriter.reopen(result_path(directory, TIMELINE))  # simulates a timeline left open
        raise ChildError(remaining_codes.pop(0), "the process died (SIGKILL).")

    monkeypatch.setattr(Child, "call", crash)
    monkeypatch.setattr(execution, "MAX_CRASHES", 2)
    monkeypatch.setattr(execution, "RETRY_INTERVAL_S", 0.0)


def test_fold_whose_process_dies_repeatedly_fails_alone(
    service_with: ServiceWith, monkeypatch: pytest.MonkeyPatch
) -> None:
    crash_after(monkeypatch, CRASHED, CRASHED)
    service = service_with().start()
    accepted = service.fold(STAIRS)
    state = compute(service, accepted["id"])
    assert (state["status"], state["error"]["code"]) == ("failed", "crashed")
    for words in ("SIGKILL", "happened 2 times"):
        assert words in state["error"]["detail"]
    # Its motion and the report of where it stopped remain.
    assert state["summary"]["stuck"]["kind"] == "stopped"
    timeline = Timeline.open(result_path(service.directory(accepted["id"]), TIMELINE))
    assert timeline.status == "failed"
    # The machine caused the failure, not the shape: a repeated request computes the fold again.
    second_fold = service.fold(STAIRS, token=accepted["owner_token"])
    assert not second_fold["existing"] and second_fold["id"] != accepted["id"]


def test_fold_continues_if_its_process_or_fork_server_is_killed(
    service_with: ServiceWith, monkeypatch: pytest.MonkeyPatch
) -> None:
    """tests/server/processes checks that the two ends are distinguished."""
    crash_after(monkeypatch, CRASHED, LOST)
    service = service_with().start()
    fold_id = service.fold(STAIRS)["id"]
    assert compute(service, fold_id)["status"] == "verified"
    check_finished(service, fold_id)


@pytest.mark.long
def test_fold_is_paused_for_a_cheaper_one_and_continues(tmp_path: Path) -> None:
    with Service(tmp_path / "data", slice_seconds=0.2).start() as service:
        long = service.fold(shape="wrench-160", settings="robots=0")["id"]
        service.wait_exploding(long)
        short = service.fold(STAIRS)["id"]
        paused = service.wait(long, lambda state: state["progress"]["paused"] or over(state))
        assert paused["status"] == "queued" and paused["stage"] in STAGES, paused
        assert paused["progress"]["message"] == PAUSED_MESSAGE
        check_finished(service, short)
        check_finished(service, long)


def test_fold_beyond_its_time_limit_fails(service_with: ServiceWith) -> None:
    service = service_with(stage_seconds=0.2).start()
    state = compute(service, service.fold(shape="wrench-160", settings="robots=0")["id"])
    assert (state["status"], state["error"]["code"]) == ("failed", "time-limit")
    assert "0.2 s" in state["error"]["detail"]


@pytest.mark.long
def test_verified_plan_is_kept_if_the_search_for_a_better_one_fails(
    service_with: ServiceWith, monkeypatch: pytest.MonkeyPatch
) -> None:
    call, calls = Child.call, list[str]()

    def interrupt(self: Child, stage: str, directory: Path, **extra: Any) -> dict[str, Any]:
        calls.append(stage)
        if stage == "explode" and calls.count(stage) == 2:
            raise ChildError("time-limit", "the stage 'explode' took longer than it may")
        return call(self, stage, directory, **extra)

    monkeypatch.setattr(Child, "call", interrupt)
    service = service_with().start()
    state = compute(service, service.fold(STAIRS, prefer="time")["id"])
    assert calls[-5:] == ["explode", "play_back", "certify", "explode", "export"]
    assert (state["status"], state["error"]) == ("verified", None)
    plan = Plan.load(service.directory(state["id"]) / "plan.npz")
    assert [a.get("chosen", False) for a in plan.attempts] == [True]


@pytest.mark.parametrize(
    "stage",
    [pytest.param(s, marks=[pytest.mark.long] * (s not in ("explode", "export"))) for s in STAGES],
)
def test_result_of_a_paused_stage_is_not_stored(
    service_with: ServiceWith, monkeypatch: pytest.MonkeyPatch, stage: str
) -> None:
    call = Child.call

    def interrupt(self: Child, name: str, directory: Path, **extra: Any) -> dict[str, Any]:
        if name == stage and extra["cancelled"]():
            return {"status": "failed", "reason": "it was cancelled", "again": None}
        return call(self, name, directory, **extra)

    monkeypatch.setattr(Child, "call", interrupt)
    monkeypatch.setattr(Slice, "over", lambda part: setattr(part, "ended", True) or True)
    service = service_with().start()
    fold_id = service.fold(STAIRS)["id"]
    claim = FoldClaim(fold_id, "one", stage, files=1, losses=0)
    with running_fold(service, claim) as (store, execution):
        with pytest.raises(PausedError):
            execution.run()
        row = store.fold(fold_id)
        assert (row.checkpoint, row.status, row.pauses) == (None, "queued", 1)


def test_fold_lost_with_its_workers_repeatedly_fails(service_with: ServiceWith) -> None:
    service = service_with().start()
    state = compute(service, service.fold(SNAKE)["id"], losses=MAX_LOSSES)
    assert (state["status"], state["error"]["code"]) == ("failed", "internal")
