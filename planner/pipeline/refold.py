"""Refold: from one folded shape over straight to another, in one call."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as FilePath

from planner.chain.chain import Chain
from planner.chain.path import Path
from planner.files import directory_or_aside
from planner.pipeline.request import Request
from planner.pipeline.stages import run_stages
from planner.pipeline.workspace import Workspace
from planner.plan.formats import write_chain, write_path
from planner.plan.plan import Plan
from planner.progress import Report, naming, silent


def refold(
    start: Plan,
    shape: Path | Chain,
    *,
    preset: str = "default",
    seed: int = 0,
    module_size: float | None = None,
    settings: str = "",
    directory: str | FilePath | None = None,
    progress: Report = silent,
) -> Plan:
    """Unfolds the chain of a plan and folds it into another shape: the paper's reconfiguration.

    Args:
        start: How the chain was folded into the shape that it begins as; of a refold, into the one
            that it ended as.
        shape: A path through as many cells as the chain has modules, or a chain like it.
        preset: ``default``, ``paper`` or ``direct``.
        seed: What randomness starts from.
        module_size: Size at which the plan is verified; None for the preset's.
        settings: Other numbers for ``paper`` or ``direct``, as ``damping=0.05,radial_gain=0.2``:
            see ``planner.pipeline.settings``.
        directory: Where the plan, the timeline and the model are kept; nowhere when None.
        progress: Told how far it is.

    Returns:
        One plan from the one shape over straight to the other, verified or not.

    Raises:
        InputError: ``refold-differs`` when the modules or their number do, ``refold-not-folded``
            when ``start`` does not lead from straight to folded, or as ``planner.fold``.
    """
    with directory_or_aside(directory) as folder:
        data = write_path(shape) if isinstance(shape, Path) else write_chain(shape)
        request = Request(
            filename=shape.name,
            preset=preset,
            seed=seed,
            module_size=module_size,
            settings=settings,
        )
        workspace = Workspace(folder)
        workspace.write_start(start)
        workspace.write_request(replace(request, refold=True), data)
        run_stages(folder, progress=naming(folder, progress))
        return workspace.read_plan()
