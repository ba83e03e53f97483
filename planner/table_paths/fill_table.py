"""Cells filled with cubes along paths in which the chain can fold on a table."""

from __future__ import annotations

import numpy as np

from planner.chain.chain import Chain
from planner.chain.path import Path
from planner.errors import InputError
from planner.pathfinding.filled import Filled
from planner.pathfinding.knots import knot_of
from planner.pathfinding.options import DEFAULT_MODULES, PathOptions
from planner.shapes.shape import Shape
from planner.table_paths.table_paths import TablePath, table_paths

SIDES: dict[str, str] = {
    "+x": "right",
    "-x": "left",
    "+y": "back",
    "-y": "front",
    "+z": "top",
    "-z": "bottom",
}
"""What people call the sides of a shape that may lie down."""


class TableCubes:
    """One cube in each cell; see ``planner.pathfinding.filling.Filling``."""

    def cells_for(self, options: PathOptions) -> int:
        """How many cells a solid should be voxelised into."""
        return DEFAULT_MODULES if options.modules is None else options.modules

    def modules_of(self, shape: Shape, options: PathOptions) -> int:
        """One for each cell."""
        del options
        return len(shape)

    def fill(
        self, shape: Shape, options: PathOptions, *, of_solid: bool, seed: int, time_limit_s: float
    ) -> Filled:
        """Finds chains through cells; a shape that was drawn as a mesh keeps standing."""
        del options, time_limit_s
        notes: tuple[str, ...] = ()
        paths: tuple[TablePath, ...] = ()
        try:
            paths = table_paths(shape.cells, seed=seed, turned=not of_solid)
        except InputError as error:
            notes = (f"No path for a table: {error.detail}",)
        if paths and paths[0].down != "-z":
            notes = (f"It lies on its {SIDES[paths[0].down]} side.",)
        cells = paths[0].cells if paths else shape.cells
        return Filled(
            chains=tuple(
                Chain.from_path(Path.from_cells(path.cells, name=shape.name, pitch_m=shape.pitch_m))
                for path in paths
            ),
            shape=Shape.from_cells(cells, name=shape.name, pitch_m=shape.pitch_m),
            method="table",
            feasibility=None,
            cells=cells,
            line=cells.astype(np.float64) if paths else np.zeros((0, 3)),
            knot=knot_of(cells) if paths else None,
            notes=notes,
            not_started="",
            scale=1.0,
            shift=-0.5,
            modules_per_cell=1,
        )

    def check(self, shape: Shape, options: PathOptions) -> None:
        """Refuses given cells that have no path for a table.

        Raises:
            InputError: As ``table_paths`` does.
        """
        del options
        table_paths(shape.cells, most=1)
