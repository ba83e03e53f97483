"""Robot runs: all robots of a playback, each of which folds the chain once, in parallel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from threading import Event, Lock
from typing import Final

from foldback.planner.cpu_cores import cores
from foldback.planner.errors import InputError
from foldback.planner.motion.motion import Motion
from foldback.planner.parameters.explosion import MUJOCO
from foldback.planner.playback.chain_run import Run
from foldback.planner.playback.reference_trajectory import ReferenceTrajectory
from foldback.planner.playback.robot_run import RobotRun, fold_with_robots
from foldback.planner.playback.window_run import WindowRun
from foldback.planner.playback.window_trajectory import WindowTrajectory
from foldback.planner.progress import Cancelled, Progress, Report
from foldback.planner.simulation.mujoco_chain import refuse_long_chain
from foldback.planner.simulation.mujoco_tree import ROOT_DOFS

AnyRun = Run | RobotRun | WindowRun
Fold = Callable[[Report, Cancelled], Sequence[AnyRun]]
"""Function that folds and returns its runs, given ``progress`` and ``cancelled``."""
MAX_MUJOCO_S: Final = 1.0
"""Maximum estimated time of the processor, s, that MuJoCo may take for its own simulation of a
robot; a longer one is left out."""


def simulate_robots(
    trajectory: ReferenceTrajectory | WindowTrajectory,
    seed: int,
    sink: Callable[[Motion], None] | None,
    progress: Report,
    cancelled: Cancelled,
) -> tuple[Sequence[AnyRun], RobotRun | None]:
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
    elif trajectory.folds_robots:
        refuse_long_chain(trajectory.chain)
        trajectory, _ = trajectory.for_mujoco()

    seeds = [[seed, number] for number in range(trajectory.robots)]
    folds = list[Fold]()
    if isinstance(trajectory, WindowTrajectory):
        folds = [partial(_fold_window, trajectory, one) for one in seeds]
    elif not trajectory.folds_robots:
        folds = [partial(_fold_by_motors, trajectory, sink)]
    elif trajectory.by_mujoco:
        folds = [partial(fold_with_robots, trajectory, [one], sink) for one in seeds]
    else:
        folds = [partial(fold_with_robots, trajectory, seeds, sink)]
    if in_mujoco is not None:
        folds.append(partial(fold_with_robots, in_mujoco, seeds[:1], None))
    runs = [run for some in _beside(folds, progress, cancelled) for run in some]
    by_mujoco = runs.pop() if in_mujoco is not None else None
    assert by_mujoco is None or isinstance(by_mujoco, RobotRun)
    return runs, by_mujoco


def _fold_window(
    trajectory: WindowTrajectory, seed: list[int], progress: Report, cancelled: Cancelled
) -> Sequence[AnyRun]:
    run = WindowRun(trajectory, seed)
    run.simulate(progress, cancelled)
    return [run]


def _fold_by_motors(
    trajectory: ReferenceTrajectory,
    sink: Callable[[Motion], None] | None,
    progress: Report,
    cancelled: Cancelled,
) -> Sequence[AnyRun]:
    run = Run(trajectory, sink)
    run.simulate(progress, cancelled)
    return [run]


def mujoco_trajectory(
    trajectory: ReferenceTrajectory | WindowTrajectory,
) -> ReferenceTrajectory | None:
    """Return the trajectory for a robot in MuJoCo; None without robots, or if it takes too long.

    A window's rigid ends are no MuJoCo tree of a chain, so peeled chains have none.
    """
    if isinstance(trajectory, WindowTrajectory) or not trajectory.folds_robots:
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


def _beside(
    folds: Sequence[Fold], progress: Report, cancelled: Cancelled
) -> list[Sequence[AnyRun]]:
    """Fold in parallel and return the runs; the result of one does not depend on the others.

    Args:
        folds: Functions that fold, given their own ``progress`` and ``cancelled``.
        progress, cancelled: Callbacks for all together.
    """
    lock, stop = Lock(), Event()
    last: dict[int, Progress] = {}

    def fold_one(number: int) -> Sequence[AnyRun]:
        def report(now: Progress) -> None:
            with lock:
                last[number] = now
                progress(
                    replace(
                        now,
                        fraction=sum(state.fraction for state in last.values()) / len(folds),
                        steps=sum(state.steps for state in last.values()),
                        steps_per_second=sum(state.steps_per_second for state in last.values()),
                    )
                )

        def stopped() -> bool:
            with lock:
                if cancelled():
                    stop.set()
            return stop.is_set()

        return folds[number](report, stopped)

    numbers = range(len(folds))
    if min(cores(), len(folds)) == 1:
        return [fold_one(number) for number in numbers]
    # More than there are cores: of three on two cores, two first would take as long as four.
    with ThreadPoolExecutor(min(2 * cores(), len(folds))) as threads:
        return list(threads.map(fold_one, numbers))
