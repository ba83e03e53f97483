"""Durability: accepted folds are finished, whichever processes are killed meanwhile."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest

from planner.motion.timeline import Timeline
from planner.pipeline.fold_layout import TIMELINE, last_frame, result
from planner.plan.plan import Plan
from server.api.schemas import PAUSED
from server.jobs.runner import MAX_DEATHS, STAGES, Runner
from server.jobs.slices import Slice
from server.processes.children import Child, ChildError
from server.store.folds import Store, new_token
from tests.server.here import FORKS, ServiceHere
from tests.server.service import SNAKE, STAIRS, Service, over, owner

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
def test_a_worker_killed_in_mid_explosion(service_with) -> None:
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
def test_a_server_killed_in_mid_explosion(service_with) -> None:
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
def test_an_orderly_stop_keeps_the_fold_for_the_next_start(service_with) -> None:
    service = service_with().start()
    fold_id = service.fold(shape="wrench-160")["id"]
    assert service.wait_exploding(fold_id)["status"] == "running"
    followers = service.events(fold_id)
    assert next(followers)[0] == "progress"
    assert service.process is not None
    service.process.terminate()
    assert "done" not in [name for name, _ in followers]  # let go, in good order
    assert service.stop() == 0
    assert "Traceback" not in service.log.read_text()
    service.start()
    check_finished(service, fold_id)


@pytest.mark.long
def test_a_living_worker_takes_over_from_one_that_stays_dead(service_with) -> None:
    service = service_with(workers=0).start()
    with service.worker() as first:
        fold_id = service.fold(shape="wrench-160")["id"]
        service.wait_exploding(fold_id)
        with service.worker() as second:
            service.wait_workers(2)
            first.kill()
            check_finished(service, fold_id)
            assert second.poll() is None
            assert service.http.get("/ready").json()["workers"] == 1


def kill_each(service: Service, fold_id: str, kind: str, times: int) -> None:
    """Kill what computes a fold once it has recorded motion, and each that takes its place."""
    killed = set[int]()
    directory = service.directory(fold_id)

    def recorded_by(process: psutil.Process) -> bool:
        timeline = result(directory, TIMELINE)
        described = timeline / "zarr.json"
        return (
            described.exists()
            and described.stat().st_mtime > process.create_time()
            and last_frame(timeline) is not None
        )

    def enough(state: dict[str, Any]) -> bool:
        found = [one for one in service.processes(kind) if one.pid not in killed]
        if state["stage"] in ("explode", "play_back") and len(killed) < times:
            for process in found:
                if recorded_by(process):
                    process.kill()
                    killed.add(process.pid)
        return len(killed) == times or over(state)

    service.wait(fold_id, enough)
    assert len(killed) == times


def stages_fork_server(service: Service) -> psutil.Process:
    (found,) = (
        process
        for process in service.processes("server.processes.forking")
        if '["stages"]' in process.cmdline()[-1]
    )
    return found


def test_a_fold_goes_on_when_its_process_or_its_fork_server_is_killed(service: Service) -> None:
    fold_id = service.fold(shape="wrench-160", seed="91", settings="robots=0")["id"]
    service.wait_exploding(fold_id)
    kill_each(service, fold_id, "foldback stages", MAX_DEATHS - 1)
    service.wait(fold_id, lambda _: service.children("stages") != [])
    stages_fork_server(service).kill()
    check_finished(service, fold_id)


def test_a_fold_whose_process_dies_again_and_again_fails_alone(service: Service) -> None:
    options = {"shape": "wrench-80", "preset": "paper"}  # it explodes slowly
    accepted = service.fold(**options)
    service.wait_exploding(accepted["id"])
    kill_each(service, accepted["id"], "foldback stages", MAX_DEATHS)
    waiting = service.fold(STAIRS)["id"]
    state = service.wait_over(accepted["id"])
    assert state["status"] == "failed"
    assert state["error"]["code"] == "crashed"
    assert "SIGKILL" in state["error"]["detail"]
    assert f"happened {MAX_DEATHS} times" in state["error"]["detail"]
    # What was there of it stays, and tells where it was.
    assert state["summary"]["stuck"]["kind"] == "stopped"
    timeline = Timeline.open(service.directory(accepted["id"]) / "timeline.zarr")
    assert timeline.status == "failed"
    check_finished(service, waiting)
    # It was the machine's fault, not the shape's: asked for again it is computed again.
    again = service.fold(**options, token=accepted["owner_token"])
    assert not again["existing"] and again["id"] != accepted["id"]
    service.http.post(f"/api/folds/{again['id']}/cancel", headers=owner(again))
    assert service.wait_over(again["id"])["status"] == "cancelled"


def compute(service: ServiceHere, fold_id: str) -> dict[str, Any]:
    """Does what a worker does with a fold, and tells how it stands then.

    Its stages are computed in a child, as everywhere.
    """
    store = Store(service.settings)
    runner = Runner(service.settings, store, fork_server=FORKS)
    try:
        outcome = runner.run(fold_id, STAGES[0], "tests", 0)
        while not outcome["ended"] and outcome["following"] is not None:
            outcome = runner.run(fold_id, outcome["following"], "tests", outcome["epoch"])
        runner.finish(fold_id, outcome, "tests")
    finally:
        runner.stop()
        store.close()
    return service.state(fold_id)


@pytest.mark.long
def test_a_fold_makes_room_for_a_cheaper_one_and_goes_on_by_itself(
    service_with: Callable[..., Service],
) -> None:
    service = service_with(slice_seconds=0.2).start()
    long = service.fold(shape="wrench-160", settings="robots=0")["id"]
    service.wait_exploding(long)
    short = service.fold(STAIRS)["id"]
    paused = service.wait(long, lambda state: state["progress"]["paused"] or over(state))
    assert paused["status"] == "queued" and paused["stage"] in STAGES, paused
    assert paused["progress"]["message"] == PAUSED
    check_finished(service, short)
    check_finished(service, long)


def test_a_fold_that_takes_too_long_is_ended_with_a_clear_word(here_with: HereWith) -> None:
    service = here_with(stage_seconds=0.2).start()
    state = compute(service, service.fold(shape="wrench-160", settings="robots=0")["id"])
    assert (state["status"], state["error"]["code"]) == ("failed", "time-limit")
    assert "0.2 s" in state["error"]["detail"]


@pytest.mark.long
def test_a_verified_plan_outlasts_the_search_for_a_better_one(
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


@pytest.mark.parametrize("stage", STAGES)
def test_no_result_of_a_stage_that_was_cut_off_for_others_is_kept(
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
    store = Store(service.settings)
    runner = Runner(service.settings, store, fork_server=FORKS)
    try:
        epoch = store.begin(fold_id, stage, "one")
        assert epoch is not None
        outcome = runner.run(fold_id, stage, "one", epoch)
        assert (outcome["paused_by"], outcome["following"]) == ("one", stage)
        assert (store.fold(fold_id).status, store.fold(fold_id).pauses) == ("queued", 1)
    finally:
        runner.stop()
        store.close()


def test_a_fold_that_needs_too_much_memory_is_ended_with_a_clear_word(
    here_with: HereWith,
) -> None:
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


@pytest.mark.long
def test_a_fold_with_a_row_and_no_job_is_found_at_the_next_start(service_with) -> None:
    service = service_with(workers=0).start()
    fold_id = service.fold(SNAKE)["id"]
    service.kill()
    with sqlite3.connect(service.data_dir / "jobs.db") as jobs:
        assert jobs.execute("DELETE FROM workflow_status").rowcount == 1
    jobs.close()
    service.start()
    with service.worker():
        check_finished(service, fold_id)


@pytest.mark.parametrize("status", ["ERROR", "MAX_RECOVERY_ATTEMPTS_EXCEEDED"])
def test_a_job_that_failed_without_a_word_ends_its_fold(service: Service, status: str) -> None:
    busy = service.fold(shape="mallet-24", preset="paper", seed=str(len(status)))
    service.wait(busy["id"], lambda _: service.children("stages") != [])
    computing = service.children("stages")
    for child in computing:  # so that the other waits
        child.suspend()
    try:
        fold_id = service.fold(SNAKE)["id"]
        assert service.state(fold_id)["status"] == "queued"
        with sqlite3.connect(service.data_dir / "jobs.db", timeout=60) as jobs:
            change = "UPDATE workflow_status SET status = ? WHERE workflow_uuid = ?"
            assert jobs.execute(change, (status, fold_id)).rowcount == 1
        jobs.close()
        state = service.wait_over(fold_id)
        assert (state["status"], state["error"]["code"]) == ("failed", "internal")
    finally:
        for child in computing:
            child.resume()
        service.http.post(f"/api/folds/{busy['id']}/cancel", headers=owner(busy))
    assert service.wait_over(busy["id"])["status"] == "cancelled"


def test_what_was_being_uploaded_at_the_end_leaves_nothing(here_with: HereWith) -> None:
    service = here_with()
    left = service.data_dir / "uploads" / "halfway"
    left.mkdir(parents=True)
    (left / "input").write_bytes(b"[[0,0,0],")
    service.start()
    assert not left.exists()
    assert service.http.get("/api/folds").json() == {"folds": []}


@pytest.mark.long
def test_asking_again_brings_a_lost_job_back(service_with) -> None:
    service = service_with(workers=0).start()
    token = new_token()
    fold_id = service.fold(SNAKE, token=token)["id"]
    with sqlite3.connect(service.data_dir / "jobs.db") as jobs:
        assert jobs.execute("DELETE FROM workflow_status").rowcount == 1
    jobs.close()
    assert service.fold(SNAKE, token=token)["id"] == fold_id
    with service.worker():
        check_finished(service, fold_id)
