"""Attempts made beside: the same plan as one after the other, and no process left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import psutil
import pytest

from planner.chain.chain import Chain
from planner.explosion.diagnosis import Diagnosis, Kind
from planner.file_names import TIMELINE, TRIALS_DIR
from planner.motion.record import Record
from planner.motion.timeline import Timeline
from planner.parameters.parameters import preset
from planner.pipeline.attempt import MAX_EXPLOSIONS, Attempt, Trial
from planner.pipeline.attempt_pool import SPECULATION_PULSES, AttemptPool
from planner.pipeline.exploding import explode
from planner.pipeline.job import Watch
from planner.pipeline.request import FoldRequest
from planner.pipeline.retry_policy import RetryPolicy
from planner.pipeline.stages import run_stage, run_stages
from planner.pipeline.workspace import Workspace
from planner.plan.plan import Plan
from planner.plan.shape_files import write_chain, write_path
from planner.progress import Progress, never, silent
from tests.planner.chains import COIL, SQUARE, knotted

pytestmark = pytest.mark.slow


def stuck(trial: Trial, kind: Kind) -> Attempt:
    return Attempt(trial=trial, status="stalled", diagnosis=Diagnosis(kind=kind, modules=()))


CHOICE = RetryPolicy(strategies=(("simultaneous", "peel"),), seed=3)
FIRST = Trial(0, 3, "simultaneous")
STUCK = stuck(FIRST, "joints")
PUSHED = Progress(stage="explode", fraction=0.5, pushes=SPECULATION_PULSES)


def read(directory: FilePath, data: bytes, **values: Any) -> FilePath:
    directory.mkdir()
    Workspace(directory).write_request(FoldRequest(**values), data)
    run_stage("read", directory)
    return directory


def beside() -> list[psutil.Process]:
    """Processes that this one has started to make tries in."""
    return [
        child
        for child in psutil.Process().children()
        if "planner.pipeline.attempt_pool" in _command(child)
    ]


def _command(process: psutil.Process) -> list[str]:
    """Its command line, which is not there for a moment while it is loaded; none of a dead one."""
    while process.status() != psutil.STATUS_ZOMBIE:
        if words := process.cmdline():
            return words
        time.sleep(0.001)
    return []


def timeless(value: Any) -> Any:
    """Without what a clock says."""
    if isinstance(value, dict):
        return {k: timeless(v) for k, v in value.items() if k != "seconds"}
    return [timeless(v) for v in value] if isinstance(value, (list, tuple)) else value


def same_motion(one: Any, other: Any) -> None:
    for name in type(one).__dataclass_fields__:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_what_is_ahead_is_what_comes_when_the_likely_happens() -> None:
    choice = RetryPolicy(strategies=(("simultaneous", "peel"),) * 2, seed=0)
    here = Trial(0, 0, "simultaneous")
    ahead = choice.lookahead([], here)
    assert ahead[0] == Trial(1, 0, "simultaneous")  # as after joints that are stuck
    assert len(set(ahead)) == len(ahead) and here not in ahead
    buried = stuck(here, "buried")
    now = choice.next_attempt([buried])
    assert now == Trial(0, 0, "peel")
    ahead = choice.lookahead([buried], now)
    reasons: tuple[Kind, ...] = ("buried", "limit", "knot")
    for reason in reasons:
        assert choice.next_attempt([buried, stuck(now, reason)]) in ahead
    # What is known takes the place of what is likely; a plan of it may still be refused.
    straight = Attempt(trial=ahead[0], status="straight")
    first, second, *_ = choice.lookahead([buried], now, {ahead[0]: straight})
    assert first == ahead[0]
    assert second == choice.next_attempt([buried, stuck(now, "buried"), straight])


@pytest.mark.long
def test_one_that_is_made_beside_is_the_same_and_its_timeline_is_the_folds(
    tmp_path: FilePath,
) -> None:
    fold = read(tmp_path / "fold", write_path(COIL), seed=3)
    chain, parameters = Chain.from_path(COIL), preset("default")
    alone = tmp_path / "alone"
    alone.mkdir()
    second = CHOICE.next_attempt([STUCK])
    assert second == Trial(0, 3, "peel")
    record = explode(chain, second, parameters, Watch(timeline=alone / TIMELINE))
    told: list[Progress] = []
    with AttemptPool(fold, 2) as pool:
        pool.schedule(CHOICE, [], FIRST)
        assert pool.collect(fold / TIMELINE, told.append, never) is None
        watched = pool.with_speculation(told.append)
        watched(Progress(stage="explode", fraction=0.5, pushes=SPECULATION_PULSES - 1))
        assert not beside()
        watched(PUSHED)
        assert len(beside()) == 1
        pool.schedule(CHOICE, [STUCK], second)
        made = pool.collect(fold / TIMELINE, told.append, never)
        assert len(beside()) <= 1  # the one after it has been begun meanwhile
        same_motion(made.frames, record.frames)
        one, other = (Attempt.of_record(second, chain, r, parameters) for r in (made, record))
        assert replace(one, seconds=0.0) == replace(other, seconds=0.0)
        mine, theirs = (Timeline.open(place / "timeline.zarr").motion() for place in (fold, alone))
        same_motion(mine, theirs)
    assert told[1] == PUSHED
    assert not beside()
    assert not (fold / TRIALS_DIR).exists()


def test_as_many_are_made_at_once_as_there_are_workers(tmp_path: FilePath) -> None:
    fold = read(tmp_path / "fold", write_chain(knotted()), seed=3)
    seen: list[int] = []

    def soon() -> bool:
        seen.append(len(beside()))
        return len(seen) > 8

    with AttemptPool(fold, 1) as pool:
        pool.schedule(CHOICE, [STUCK], Trial(0, 3, "peel"))
        assert not beside()
    with AttemptPool(fold, 3) as pool:
        pool.schedule(CHOICE, [], FIRST)
        assert not beside()  # a fold that comes to its end at once takes one core
        pool.with_speculation(silent)(PUSHED)
        assert len(beside()) == 2
        pool.schedule(CHOICE, [STUCK], Trial(0, 3, "peel"))
        made = pool.collect(fold / TIMELINE, silent, soon)
        assert made is None or made.status == "cancelled"
        assert max(seen) == 3
        pool.end_running()
        assert not beside()


def test_a_process_that_fails_is_as_if_it_had_not_been(tmp_path: FilePath) -> None:
    fold = read(tmp_path / "fold", write_path(COIL), seed=3)
    second = Trial(0, 3, "peel")
    with AttemptPool(fold, 2) as pool:
        pool.schedule(CHOICE, [], FIRST)
        pool.with_speculation(silent)(PUSHED)
        (child,) = beside()
        child.kill()
        pool.schedule(CHOICE, [STUCK], second)
        assert pool.collect(fold / TIMELINE, silent, never) is None


def test_one_that_cannot_be_begun_does_not_end_the_one_at_hand(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    fold = read(tmp_path / "fold", write_path(COIL), seed=3)

    def none_left(*_: Any, **__: Any) -> None:
        raise BlockingIOError("no more processes")

    monkeypatch.setattr("planner.pipeline.attempt_pool.subprocess.Popen", none_left)
    with AttemptPool(fold, 2) as pool:
        pool.schedule(CHOICE, [], FIRST)
        told = pool.with_speculation(silent)
        told(PUSHED)
        told(PUSHED)
        assert not beside()
    assert not (fold / TRIALS_DIR).exists()


def test_no_more_are_begun_than_a_fold_may_have(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    fold = read(tmp_path / "fold", write_path(COIL), seed=3)
    begun: list[Trial] = []

    def begin(_: FilePath, trial: Trial) -> Running:
        begun.append(trial)
        return Running()

    monkeypatch.setattr("planner.pipeline.attempt_pool._AttemptProcess", begin)
    many = RetryPolicy(strategies=(("peel", "blocks", "one-by-one"),) * 4, seed=3)
    with AttemptPool(fold, 64) as pool:
        pool.schedule(many, [], Trial(0, 3, "peel"))
        pool.with_speculation(silent)(PUSHED)
    assert len(begun) == MAX_EXPLOSIONS - 1


class Running:
    """A try that takes its time."""

    running = True

    def attempt(self) -> None:
        return None

    def end(self) -> None:
        return None


FOLDS: dict[str, Callable[[FilePath], FilePath]] = {
    # Refused at any seed and by any strategy: modules as large as their cells always touch.
    "refused": lambda place: asked(
        place, write_path(SQUARE), module_size=1.0, strategy="simultaneous"
    ),
    "knotted": lambda place: asked(place, write_chain(knotted()), strategy="peel"),
}


def asked(directory: FilePath, data: bytes, **values: Any) -> FilePath:
    directory.mkdir()
    Workspace(directory).write_request(FoldRequest(**values), data)
    return directory


@pytest.mark.long
@pytest.mark.parametrize("name", ["refused", "knotted"])
def test_the_plan_is_the_same_for_any_number_of_workers(
    name: str, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken: list[bool] = []
    take = AttemptPool.take

    def noted(self: AttemptPool, *arguments: Any) -> Any:
        found = take(self, *arguments)
        taken.append(found is not None)
        return found

    monkeypatch.setattr(AttemptPool, "take", noted)
    places = [FOLDS[name](tmp_path / str(workers)) for workers in (1, 2)]
    summaries: list[dict[str, Any]] = []
    for workers, place in enumerate(places, start=1):
        taken.clear()
        summaries.append(run_stages(place, workers=workers))
        assert any(taken) == (workers > 1)
    assert timeless(summaries[0]) == timeless(summaries[1])
    one, two = (Plan.load(place / "plan.npz") for place in places)
    assert len(one.attempts) >= 2
    assert timeless(one.attempts) == timeless(two.attempts)
    same_motion(one.motion, two.motion)
    records = [Record.load(place / "record.npz") for place in places]
    same_motion(records[0].frames, records[1].frames)
    same_motion(*(Timeline.open(place / "timeline.zarr").motion() for place in places))
    assert {p.name for p in places[0].iterdir()} == {p.name for p in places[1].iterdir()}
    assert not beside()


@pytest.mark.long
def test_a_fold_that_is_cancelled_leaves_no_process(tmp_path: FilePath) -> None:
    place = FOLDS["knotted"](tmp_path / "fold")
    begun: list[psutil.Process] = []

    def once_there_are_two() -> bool:
        begun.extend(beside())
        return bool(begun)

    summary = run_stages(place, workers=2, cancelled=once_there_are_two)
    assert begun
    assert "cancelled" in summary["reason"]
    assert not beside()
    assert not any(child.is_running() for child in begun)
    assert not (place / TRIALS_DIR).exists()


SCRIPT = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # also in the background
from pathlib import Path
from planner.pipeline.attempt import Attempt, Trial
from planner.pipeline.retry_policy import RetryPolicy
from planner.pipeline.attempt_pool import AttemptPool
with AttemptPool(Path(sys.argv[1]), 3) as pool:
    choice = RetryPolicy(strategies=(("simultaneous", "peel"),), seed=3)
    pool.schedule(choice, [Attempt(trial=Trial(0, 3, "peel"), status="stalled")],
                  Trial(0, 3, "simultaneous"))
    time.sleep(600.0)
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize(
    "how", [signal.SIGKILL, pytest.param(signal.SIGINT, marks=pytest.mark.long)]
)
def test_when_the_folds_process_ends_so_do_the_others(how: int, tmp_path: FilePath) -> None:
    fold = read(tmp_path / "fold", write_chain(knotted()))
    root = str(FilePath(__file__).parents[3])
    parent = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, str(fold)],
        env={**os.environ, "PYTHONPATH": root},
        stderr=subprocess.DEVNULL,
    )
    children: list[psutil.Process] = []
    while not any((fold / TRIALS_DIR).glob("*/timeline.zarr")):  # they are at work
        assert parent.poll() is None
        children = psutil.Process(parent.pid).children()
        time.sleep(0.05)
    assert len(children) == 2
    parent.send_signal(how)
    parent.wait()
    _, alive = psutil.wait_procs(children, timeout=60.0)
    for child in alive:
        child.kill()
    assert not alive
    if how == signal.SIGINT:
        assert not (fold / TRIALS_DIR).exists()
