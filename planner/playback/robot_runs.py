"""Robot runs: all robots of a playback, each of which folds the chain once, in parallel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Event, Lock
from typing import TypeVar

from foldback.planner.compilation.cpu_cores import cores
from foldback.planner.motion.motion import Motion
from foldback.planner.playback.chain_run import Run
from foldback.planner.playback.reference_trajectory import ReferenceTrajectory
from foldback.planner.playback.window_run import WindowRun
from foldback.planner.playback.window_trajectory import WindowTrajectory
from foldback.planner.progress import Cancelled, Progress, Report


def simulate_robots(
    trajectory: ReferenceTrajectory | WindowTrajectory,
    seed: int,
    sink: Callable[[Motion], None] | None,
    progress: Report,
    cancelled: Cancelled,
) -> Sequence[Run | WindowRun]:
    """Simulate all robots of a trajectory and return their runs."""

    def simulate_one(number: int, report: Report, stopped: Cancelled) -> Run | WindowRun:
        if isinstance(trajectory, WindowTrajectory):
            run = WindowRun(trajectory, [seed, number])
            run.simulate(report, stopped)
        else:
            run = Run(trajectory, [seed, number])
            run.simulate(sink, report, stopped)
        return run

    return _beside(trajectory.robots, simulate_one, progress, cancelled)


R = TypeVar("R")


def _beside(
    robots: int,
    fold: Callable[[int, Report, Cancelled], R],
    progress: Report,
    cancelled: Cancelled,
) -> list[R]:
    """Fold with several robots in parallel and return their results.

    The result of one does not depend on the others. Most of a step is MuJoCo's, which lets other
    threads run meanwhile.

    Args:
        robots: Number of robots.
        fold: Folds with one robot, given its number and its own ``progress`` and ``cancelled``.
        progress, cancelled: Callbacks for all together.
    """
    lock, stop = Lock(), Event()
    last: dict[int, Progress] = {}

    def fold_one(number: int) -> R:
        def report(now: Progress) -> None:
            with lock:
                last[number] = now
                progress(
                    replace(
                        now,
                        fraction=sum(state.fraction for state in last.values()) / robots,
                        steps=sum(state.steps for state in last.values()),
                        steps_per_second=sum(state.steps_per_second for state in last.values()),
                    )
                )

        def stopped() -> bool:
            with lock:
                if cancelled():
                    stop.set()
            return stop.is_set()

        return fold(number, report, stopped)

    numbers = range(robots)
    if min(cores(), robots) == 1:
        return [fold_one(number) for number in numbers]
    # More than there are cores: of three on two cores, two first would take as long as four.
    with ThreadPoolExecutor(min(2 * cores(), robots)) as threads:
        return list(threads.map(fold_one, numbers))
