"""Robot runs: all robots of a playback, each of which folds the chain once, in parallel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Event, Lock
from typing import Final, TypeVar

from foldback.planner.cpu_cores import cores
from foldback.planner.errors import InputError
from foldback.planner.motion.motion import Motion
from foldback.planner.parameters.explosion import MUJOCO
from foldback.planner.playback.chain_run import Run
from foldback.planner.playback.reference_trajectory import ReferenceTrajectory
from foldback.planner.playback.window_run import WindowRun
from foldback.planner.playback.window_trajectory import WindowTrajectory
from foldback.planner.progress import Cancelled, Progress, Report
from foldback.planner.simulation.mujoco_chain import refuse_long_chain
from foldback.planner.simulation.mujoco_tree import ROOT_DOFS

MAX_MUJOCO_S: Final = 1.0
"""Maximum estimated time of the processor, s, that MuJoCo may take for its own simulation of a
robot; a longer one is left out."""


def simulate_robots(
    trajectory: ReferenceTrajectory | WindowTrajectory,
    seed: int,
    sink: Callable[[Motion], None] | None,
    progress: Report,
    cancelled: Cancelled,
) -> tuple[Sequence[Run | WindowRun], Run | None]:
    """Simulate all robots of a trajectory, and the first one by MuJoCo, too.

    With ``engine=mujoco``, MuJoCo simulates all of them.

    Returns:
        The runs of the robots, and the one by MuJoCo; None where that would take too long.

    Raises:
        InputError: ``too-long-for-mujoco``, or ``peeled-in-mujoco`` for a peeled chain.
    """
    in_mujoco = None
    if trajectory.parameters.robot.engine != MUJOCO:
        in_mujoco = mujoco_trajectory(trajectory)
    elif isinstance(trajectory, WindowTrajectory):
        raise InputError(
            "peeled-in-mujoco",
            "got a peeled chain with engine=mujoco, which simulates all modules at once; use the "
            "strategy 'simultaneous', or leave out engine=mujoco.",
        )
    elif trajectory.contacts is not None:
        refuse_long_chain(trajectory.chain)
        trajectory, _ = trajectory.for_mujoco()

    def simulate_one(number: int, report: Report, stopped: Cancelled) -> Run | WindowRun:
        if isinstance(trajectory, WindowTrajectory):
            run = WindowRun(trajectory, [seed, number])
            run.simulate(report, stopped)
        elif in_mujoco is not None and number == trajectory.robots:
            run = Run(in_mujoco, [seed, 0])
            run.simulate(report, stopped)
        else:
            run = Run(trajectory, [seed, number], sink)
            run.simulate(report, stopped)
        return run

    robots = trajectory.robots
    runs = _beside(robots + (in_mujoco is not None), simulate_one, progress, cancelled)
    by_mujoco = runs[robots] if len(runs) > robots else None
    assert not isinstance(by_mujoco, WindowRun)
    return runs[:robots], by_mujoco


def mujoco_trajectory(
    trajectory: ReferenceTrajectory | WindowTrajectory,
) -> ReferenceTrajectory | None:
    """Return the trajectory for a robot in MuJoCo; None without robots, or if it takes too long.

    A window's rigid ends are no MuJoCo tree of a chain, so peeled chains have none.
    """
    if isinstance(trajectory, WindowTrajectory) or trajectory.contacts is None:
        return None
    steps = sum(len(scaling) for _, _, scaling in trajectory.curves)
    hinges = len(trajectory.chain.folded_rad)
    if mujoco_seconds(hinges, steps) > MAX_MUJOCO_S:
        return None
    divided, steps = trajectory.for_mujoco()
    return divided if mujoco_seconds(hinges, steps) <= MAX_MUJOCO_S else None


def mujoco_seconds(hinges: int, steps: int) -> float:
    """Return the estimated time of the processor of a simulation by MuJoCo, s.

    It is that of a processor which makes 1000 steps of a tree of 160 cubes in 0.26 s, and depends
    on no clock: docs/decisions/0058-a-robot-by-mujoco.md.
    """
    dofs = hinges + ROOT_DOFS
    return steps * (4e-5 + 2.5e-9 * dofs**2 + 1.1e-11 * dofs**3)


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
