"""Cells filled with cubes: one each, or eight of half the pitch, along a Hamiltonian path."""

from __future__ import annotations

import time
from typing import Final

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import LONG_CHAIN
from foldback.planner.errors import InputError
from foldback.planner.pathfinding.block_merging import halved
from foldback.planner.pathfinding.feasibility import Feasibility, Repair, apply_repair, feasibility
from foldback.planner.pathfinding.filled_shape import FilledShape
from foldback.planner.pathfinding.knots import knot_of
from foldback.planner.pathfinding.lattice import parts
from foldback.planner.pathfinding.path_options import DEFAULT_MODULES, PathOptions
from foldback.planner.pathfinding.path_reasons import PathCode, PathReason
from foldback.planner.pathfinding.path_search import PathSearch, find_paths
from foldback.planner.shapes.shape import Shape

BLOCK_CELLS: Final = 8
"""Number of cells, 2×2×2, by which a repair replaces each voxel of a shape, as such shapes always
have a path."""
DOUBLED: Final = "Each cell of the file became 2×2×2 modules."
ALWAYS_A_PATH: Final = " A connected shape of 2×2×2 blocks always has a path."


class Cubes:
    """Filling with cubes, one in each cell or eight."""

    def cells_for(self, options: PathOptions) -> int:
        """Return the number of cells for the voxelisation of a solid."""
        modules = DEFAULT_MODULES if options.modules is None else options.modules
        return max(1, round(modules / BLOCK_CELLS)) if _in_blocks(options) else modules

    def modules_of(self, shape: Shape, options: PathOptions, *, of_solid: bool) -> int:
        """Return the number of modules of given cells, as far as it is known without a path."""
        doubles = _in_blocks(options) if of_solid else options.method == "blocks"
        return BLOCK_CELLS * len(shape) if doubles else len(shape)

    def fill(
        self, shape: Shape, options: PathOptions, *, of_solid: bool, seed: int, time_limit_s: float
    ) -> FilledShape:
        """Find chains through cells; see ``planner.pathfinding.filling_methods.FillingMethod``."""
        notes: tuple[str, ...] = ()
        was_doubled, repaired = False, ""
        cell_count = len(shape)
        method = options.method
        if of_solid and _in_blocks(options):
            shape = doubled(shape)
            method = method if len(shape) >= LONG_CHAIN else "blocks"
        elif method == "blocks" and halved(shape) is None:
            shape, was_doubled = doubled(shape), True
        elif options.modules not in (None, cell_count) and not options.repair and not of_solid:
            notes = (f"Each cell became one module, so the chain has {cell_count} modules.",)
        scale = round((len(shape) / cell_count) ** (1 / 3))
        state = feasibility(shape)
        if was_doubled:
            notes = (DOUBLED if state.feasible is False else f"{DOUBLED}{ALWAYS_A_PATH}",)
        if state.feasible is False and options.repair and state.repairs:
            repair = requested_repair(shape, state, options)
            if repair is not None:
                shape = apply_repair(shape, repair)
                repaired = repair.done
                state = feasibility(shape)
            else:
                notes = (*notes, only_doubling(shape, state.repairs[0]))
        search: PathSearch | None = None
        not_started: tuple[PathReason, ...] = ()
        if state.feasible is not False:
            search, not_started = _searched(shape, method, options, seed, time_limit_s)
            notes = (*notes, *(reason.text for reason in search.reasons))
        paths = () if search is None else search.paths
        return FilledShape(
            chains=tuple(Chain.from_path(path) for path in paths),
            shape=shape,
            method=method if search is None else search.method,
            feasibility=state,
            cells=paths[0].cells if paths else shape.cells,
            line=paths[0].cells.astype(np.float64) if paths else np.zeros((0, 3)),
            knot=knot_of(paths[0].cells) if paths else None,
            notes=notes,
            not_started=not_started,
            scale=float(scale),
            shift=-0.5,
            modules_per_cell=scale**3,
            reasons=() if search is None else search.reasons,
            repaired=repaired,
        )

    def check(self, shape: Shape, options: PathOptions) -> None:
        """Refuse given cells without a path if that is quickly proved."""
        if options.method == "blocks":
            if parts(shape.cells)[0] == 1:
                return
            shape = doubled(shape) if halved(shape) is None else shape
        state = feasibility(shape)
        if state.feasible is not False:
            return
        if options.repair and state.repairs:
            if requested_repair(shape, state, options) is not None:
                return
            raise InputError("no-path", only_doubling(shape, state.repairs[0]))
        reasons = [problem.sentence for problem in state.problems]
        ways: list[str] = []
        if state.repairs:
            ways.append(
                f"Use the option 'repair' to change the shape: {repair_words(shape, state)}"
            )
        if not any(problem.code is PathCode.DISCONNECTED for problem in state.problems):
            ways.append(
                f"{'Or use' if ways else 'Use'} the method 'blocks', which splits each cell into "
                "2×2×2 modules, so that there is always a path."
            )
        raise InputError(
            "no-path",
            " ".join(["got a shape without a path through all its cells.", *reasons, *ways]),
            reasons=[problem.reason.as_dict() for problem in state.problems],
        )


def _in_blocks(options: PathOptions) -> bool:
    return options.method in ("auto", "blocks")


def _searched(
    shape: Shape, method: str, options: PathOptions, seed: int, time_limit_s: float
) -> tuple[PathSearch, tuple[PathReason, ...]]:
    """Return paths from the requested start; without any, other paths and the reasons."""
    start_s = time.monotonic()
    share = 1.0 if options.start is None else 0.7  # the rest of the time is for other starts
    search = find_paths(
        shape,
        method=method,
        ends=options.ends,
        start=options.start,
        seed=seed,
        time_limit_s=share * time_limit_s,
    )
    if options.start is None or search.paths:
        return search, ()
    reason = PathReason.of(PathCode.NOT_STARTED, cell=options.start)
    remaining_s = time_limit_s - (time.monotonic() - start_s)
    return find_paths(
        shape, method=method, ends=options.ends, seed=seed, time_limit_s=max(0.5, remaining_s)
    ), (reason, *search.reasons)


def requested_repair(shape: Shape, state: Feasibility, options: PathOptions) -> Repair | None:
    """Return the smallest repair; one that doubles only if the requested modules allow it.

    Returns:
        None if only doubling helps and the requested number of modules does not allow it.
    """
    repair = state.repairs[0]
    count = modules_after(shape, repair)
    fits_request = options.modules is not None and count <= 1.25 * options.modules
    return repair if fits_request or not repair.doubled else None


def repair_words(shape: Shape, state: Feasibility) -> str:
    """Return the nearest sets of cells that have a path, to follow a colon.

    They are the first repair, and another one that does not split cells.
    """
    first, *other_repairs = state.repairs
    near = [first, *(repair for repair in other_repairs[:1] if not repair.doubled)]
    steps = [
        f"{repair.as_step.rstrip('.')}, for {modules_after(shape, repair)} modules"
        for repair in near
    ]
    return first.as_step if first.doubled else f"{', or '.join(steps)}."


def modules_after(shape: Shape, repair: Repair) -> int:
    """Return the number of modules after a repair."""
    cells = len(shape) + len(repair.add) - len(repair.drop)
    return BLOCK_CELLS * cells if repair.doubled else cells


def only_doubling(shape: Shape, repair: Repair) -> str:
    """Return the message for shapes that only doubling would repair."""
    count = modules_after(shape, repair)
    return (
        f"The only repair that was found makes {count} modules from {len(shape)} cells: "
        f"{repair.as_step} Request {count} modules to get this repair, or use the method 'blocks'."
    )


def doubled(shape: Shape) -> Shape:
    """Split each cell into 2×2×2 cells of half the pitch."""
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    cells = (2 * shape.cells[:, None, :] + corners).reshape(-1, 3)
    return Shape.from_cells(cells, name=shape.name, pitch_m=0.5 * shape.pitch_m)


__all__ = [
    "Cubes",
    "doubled",
    "modules_after",
    "only_doubling",
    "repair_words",
    "requested_repair",
]
