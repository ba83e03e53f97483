"""Cells filled with cubes along paths in which the chain can fold on a table."""

from __future__ import annotations

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.pathfinding import Cell
from foldback.planner.pathfinding.block_merging import halved
from foldback.planner.pathfinding.feasibility import Feasibility, Problem
from foldback.planner.pathfinding.fill_cubes import BLOCK_CELLS, doubled
from foldback.planner.pathfinding.filled_shape import FilledShape
from foldback.planner.pathfinding.knots import knot_of
from foldback.planner.pathfinding.no_path_proofs import tuples
from foldback.planner.pathfinding.path_options import DEFAULT_MODULES, PathOptions
from foldback.planner.shapes.shape import Shape
from foldback.planner.table_paths.base_sides import SIDE_NAMES, sides_of
from foldback.planner.table_paths.mending import (
    added_words,
    cells_to_add,
    nearest_words,
    with_cells,
)
from foldback.planner.table_paths.no_table_path_proofs import (
    NoPath,
    closest,
    no_path_error,
    ruled_out,
)
from foldback.planner.table_paths.table_paths import paths_or_reasons


class TableCubes:
    """Filling with one cube in each cell, or eight, for chains that fold on a table."""

    def cells_for(self, options: PathOptions) -> int:
        """Return the number of cells for the voxelisation of a solid."""
        modules = DEFAULT_MODULES if options.modules is None else options.modules
        return max(1, round(modules / BLOCK_CELLS)) if options.method == "blocks" else modules

    def modules_of(self, shape: Shape, options: PathOptions, *, of_solid: bool) -> int:
        """Return the number of modules of given cells: one for each, or eight."""
        doubles = _doubles(shape, options, of_solid=of_solid)
        return BLOCK_CELLS * len(shape) if doubles else len(shape)

    def fill(
        self, shape: Shape, options: PathOptions, *, of_solid: bool, seed: int, time_limit_s: float
    ) -> FilledShape:
        """Find chains through cells; a mesh keeps its orientation."""
        del time_limit_s
        notes: tuple[str, ...] = ()
        repaired, added = "", list[Cell]()
        doubles = _doubles(shape, options, of_solid=of_solid)
        if doubles:
            shape = doubled(shape)
        turned = not of_solid
        paths, reasons = paths_or_reasons(shape.cells, seed=seed, turned=turned)
        if not paths and options.repair and (added := cells_to_add(shape.cells, seed)):
            shape = with_cells(shape, added)
            paths, reasons = paths_or_reasons(shape.cells, seed=seed, turned=False)
            repaired = added_words(added)
        shift = paths[0].shift if paths else np.zeros(3, dtype=np.int64)
        turn = np.asarray(paths[0].turn if paths else np.eye(3), dtype=np.float64)
        if paths and paths[0].down != "-z":
            notes = (*notes, f"The shape lies on its {SIDE_NAMES[paths[0].down]} side.")
        cells = paths[0].cells if paths else shape.cells
        return FilledShape(
            chains=tuple(
                Chain.from_path(Path.from_cells(path.cells, name=shape.name, pitch_m=shape.pitch_m))
                for path in paths
            ),
            shape=Shape.from_cells(cells, name=shape.name, pitch_m=shape.pitch_m),
            method="table",
            feasibility=None if paths else _why_none(shape, reasons),
            cells=cells,
            line=cells.astype(np.float64) if paths else np.zeros((0, 3)),
            knot=knot_of(cells) if paths else None,
            notes=notes,
            not_started=(),
            scale=2.0 if doubles else 1.0,
            shift=np.asarray(shift - turn @ np.full(3, 0.5), dtype=np.float64),
            modules_per_cell=BLOCK_CELLS if doubles else 1,
            repaired=repaired,
            added=tuples(np.array(added, dtype=np.int64).reshape(-1, 3) + shift),
            turn=turn,
        )

    def check(self, shape: Shape, options: PathOptions) -> None:
        """Refuse given cells that are quickly proved to have no path for a table.

        Raises:
            InputError: ``overhang``, ``parts``, ``hairpins-only``, ``not-stable`` or ``no-path``.
        """
        if options.repair:
            return
        if _doubles(shape, options, of_solid=False):
            shape = doubled(shape)
        reasons = [ruled_out(side) for side in sides_of(shape.cells)]
        proved = tuple(reason for reason in reasons if reason is not None and not reason.may_fall)
        if len(proved) == len(reasons):
            raise no_path_error(proved, nearest_words(shape.cells))


def _doubles(shape: Shape, options: PathOptions, *, of_solid: bool) -> bool:
    """Return True if each cell becomes 2×2×2 modules."""
    return options.method == "blocks" and (of_solid or halved(shape) is None)


def _why_none(shape: Shape, reasons: tuple[NoPath, ...]) -> Feasibility:
    """Return the reason without a path, with cells in the frame of the given shape."""
    reason = closest(reasons)
    side = next(side for side in sides_of(shape.cells, turned=True) if side.down == reason.down)
    lying = np.array(reason.cells, dtype=np.int64).reshape(-1, 3)
    cells = tuple((int(x), int(y), int(z)) for x, y, z in (lying - side.shift) @ side.turn)
    return Feasibility(
        feasible=None,
        problems=(Problem(reason=reason.reason, cells=cells),),
    )
