"""Smooth: from a verified plan to a shorter and quieter one, in one call."""

from __future__ import annotations

from pathlib import Path as FilePath

from planner.files import directory_or_aside
from planner.pipeline.stages import run_stages
from planner.pipeline.workspace import Workspace
from planner.plan.plan import Plan
from planner.progress import Report, naming, silent


def smooth_plan(
    plan: Plan,
    *,
    seed: int = 0,
    module_size: float | None = None,
    directory: str | FilePath | None = None,
    progress: Report = silent,
) -> Plan:
    """Smooths the motion of a plan: shortcuts, means and a new time law, certified anew.

    Args:
        plan: A verified plan that begins straight.
        seed: What randomness starts from.
        module_size: Size at which the result is verified; None for that of the plan.
        directory: Where the plan, the timeline and the model are kept; nowhere when None.
        progress: Told how far it is.

    Returns:
        The smoothed plan, verified or not; ``Plan.smoothing`` says what has changed.

    Raises:
        InputError: As ``planner.robot.smoothed.check_smoothable``, or for a seed or size out of
            range.
    """
    with directory_or_aside(directory) as folder:
        workspace = Workspace(folder)
        workspace.write_smoothing(plan, seed=seed, module_size=module_size)
        run_stages(folder, progress=naming(folder, progress))
        return workspace.read_plan()
