"""Parallel attempts: the plan equals that of sequential ones, and no process is left behind."""

import os
import subprocess
import sys
import time
from pathlib import Path as FilePath
from typing import Any
from unittest.mock import Mock

import psutil
import pytest

from foldback.planner.explosion.diagnosis import Diagnosis, Kind
from foldback.planner.pipeline.attempt import MAX_EXPLOSIONS, Attempt, AttemptSpec
from foldback.planner.pipeline.attempt_pool import SPECULATION_PULSES, AttemptPool
from foldback.planner.pipeline.retry_policy import RetryPolicy
from foldback.planner.pipeline.stages import run_stage
from foldback.planner.plan.shape_writers import write_chain, write_path
from foldback.planner.progress import Progress, never, silent
from foldback.planner.storage.file_names import TIMELINE, TRIALS_DIR
from tests.planner.chains import COIL, knotted
from tests.planner.folds import write_request

pytestmark = pytest.mark.slow


def stuck(spec: AttemptSpec, kind: Kind) -> Attempt:
    return Attempt(spec=spec, status="stalled", diagnosis=Diagnosis(kind=kind, modules=()))


CHOICE = RetryPolicy(strategies=(("simultaneous", "peel"),), seed=3)
FIRST = AttemptSpec(0, 3, "simultaneous")
STUCK = stuck(FIRST, "joints")
STALLING = Progress(stage="explode", fraction=0.5, pushes=SPECULATION_PULSES)


def read(directory: FilePath, data: bytes, **values: Any) -> FilePath:
    run_stage("read", write_request(directory, data, **values))
    return directory


def attempt_processes() -> list[psutil.Process]:
    """Return the child processes of this one that run attempts."""
    return [
        child
        for child in psutil.Process().children()
        if "foldback.planner.pipeline.attempt_process" in _command(child)
    ]


def _command(process: psutil.Process) -> list[str]:
    """Return the command line; it is empty for a zombie, and briefly while a process starts."""
    while process.status() != psutil.STATUS_ZOMBIE:
        if words := process.cmdline():
            return words
        time.sleep(0.001)
    return []


def test_lookahead_lists_the_likely_next_attempts() -> None:
    choice = RetryPolicy(strategies=(("simultaneous", "peel"),) * 2, seed=0)
    current = AttemptSpec(0, 0, "simultaneous")
    ahead = choice.lookahead([], current)
    assert ahead[0] == AttemptSpec(1, 0, "simultaneous")  # the next attempt if joints stall
    assert len(set(ahead)) == len(ahead) and current not in ahead
    buried = stuck(current, "buried")
    following = choice.next_attempt([buried])
    assert following == AttemptSpec(0, 0, "peel")
    ahead = choice.lookahead([buried], following)
    reasons: tuple[Kind, ...] = ("buried", "limit", "knot")
    for reason in reasons:
        assert choice.next_attempt([buried, stuck(following, reason)]) in ahead
    # Known results replace predicted ones; a plan from them may still be refused.
    straight = Attempt(spec=ahead[0], status="straight")
    first, second, *_ = choice.lookahead([buried], following, {ahead[0]: straight})
    assert first == ahead[0]
    assert second == choice.next_attempt([buried, stuck(following, "buried"), straight])


def test_number_of_parallel_attempts_is_that_of_the_workers(tmp_path: FilePath) -> None:
    fold = read(tmp_path / "fold", write_chain(knotted()), seed=3)
    process_ids: list[int] = []

    def stop_after_eight_polls() -> bool:
        process_ids.append(len(attempt_processes()))
        return len(process_ids) > 8

    with AttemptPool(fold, 1) as pool:
        pool.schedule(CHOICE, [STUCK], AttemptSpec(0, 3, "peel"))
        assert not attempt_processes()
    with AttemptPool(fold, 3) as pool:
        pool.schedule(CHOICE, [], FIRST)
        assert not attempt_processes()  # a fold that ends quickly uses one core
        pool.with_speculation(silent)(STALLING)
        assert len(attempt_processes()) == 2
        pool.schedule(CHOICE, [STUCK], AttemptSpec(0, 3, "peel"))
        collected = pool.collect(fold / TIMELINE, silent, stop_after_eight_polls)
        assert collected is None or collected.status == "cancelled"
        assert max(process_ids) == 3
        pool.end_running()
        assert not attempt_processes()


def test_attempt_whose_process_fails_or_does_not_start_is_not_collected(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    fold = read(tmp_path / "fold", write_path(COIL), seed=3)
    with AttemptPool(fold, 2) as pool:
        pool.schedule(CHOICE, [], FIRST)
        pool.with_speculation(silent)(STALLING)
        (child,) = attempt_processes()
        child.kill()
        pool.schedule(CHOICE, [STUCK], AttemptSpec(0, 3, "peel"))
        assert pool.collect(fold / TIMELINE, silent, never) is None
    refuse_process = Mock(side_effect=BlockingIOError("no more processes"))
    monkeypatch.setattr("foldback.planner.pipeline.attempt_pool.subprocess.Popen", refuse_process)
    with AttemptPool(fold, 2) as pool:
        pool.schedule(CHOICE, [], FIRST)
        report = pool.with_speculation(silent)
        report(STALLING)
        report(STALLING)
        assert not attempt_processes()
    assert not (fold / TRIALS_DIR).exists()


def test_number_of_attempts_of_a_fold_is_limited(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    fold = read(tmp_path / "fold", write_path(COIL), seed=3)
    start_attempt = Mock(return_value=Mock(running=True, attempt=lambda: None))
    monkeypatch.setattr("foldback.planner.pipeline.attempt_pool._AttemptProcess", start_attempt)
    many_strategies = RetryPolicy(strategies=(("peel", "blocks", "one-by-one"),) * 4, seed=3)
    with AttemptPool(fold, 64) as pool:
        pool.schedule(many_strategies, [], AttemptSpec(0, 3, "peel"))
        pool.with_speculation(silent)(STALLING)
    assert start_attempt.call_count == MAX_EXPLOSIONS - 1


SCRIPT = """
import sys, time
from pathlib import Path
from foldback.planner.pipeline.attempt import Attempt, AttemptSpec
from foldback.planner.pipeline.retry_policy import RetryPolicy
from foldback.planner.pipeline.attempt_pool import AttemptPool
with AttemptPool(Path(sys.argv[1]), 3) as pool:
    choice = RetryPolicy(strategies=(("simultaneous", "peel"),), seed=3)
    pool.schedule(choice, [Attempt(spec=AttemptSpec(0, 3, "peel"), status="stalled")],
                  AttemptSpec(0, 3, "simultaneous"))
    time.sleep(600.0)
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_attempt_processes_end_with_their_fold(tmp_path: FilePath) -> None:
    fold = read(tmp_path / "fold", write_chain(knotted()))
    root = str(FilePath(__file__).parents[3])
    parent = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, str(fold)],
        env={**os.environ, "PYTHONPATH": root},
        stderr=subprocess.DEVNULL,
    )
    children: list[psutil.Process] = []
    while not any((fold / TRIALS_DIR).glob("*/timeline")):  # the processes are running
        assert parent.poll() is None
        children = psutil.Process(parent.pid).children()
        time.sleep(0.05)
    assert len(children) == 2
    parent.kill()
    parent.wait()
    _, alive = psutil.wait_procs(children, timeout=60.0)
    for child in alive:
        child.kill()
    assert not alive
