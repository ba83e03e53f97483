"""Fold: everything from a shape to a verified plan, in one call."""

from __future__ import annotations

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


def fold(
    shape: Path | Chain,
    *,
    preset: str = "default",
    seed: int = 0,
    module_size: float | None = None,
    settings: str = "",
    directory: str | FilePath | None = None,
    progress: Report = silent,
    workers: int = 1,
) -> Plan:
    """Explodes a shape's chain, plays the record back and verifies the result.

    Args:
        shape: A path through cells, or a chain with its folded configuration.
        preset: ``default``, ``paper`` or ``direct``.
        seed: What randomness starts from.
        module_size: Size at which the plan is verified; None for the preset's.
        settings: Other numbers for ``paper`` or ``direct``, as ``damping=0.05,radial_gain=0.2``:
            see ``planner.pipeline.settings``.
        directory: Where the plan, the timeline and the model are kept; nowhere when None.
        progress: Told how far it is, and where: ``Progress.directory``.
        workers: Explosions that are made at once at most, when one sticks; the plan is the same.

    Returns:
        The plan, verified or not: see ``Plan.certificate``.

    Raises:
        InputError: An unknown preset, or a seed, module size or setting out of range.
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
        workspace.write_request(request, data)
        run_stages(folder, progress=naming(folder, progress), workers=workers)
        return workspace.read_plan()
