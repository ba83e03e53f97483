"""Extrusion: a drawing in cells, given a thickness, as a shape."""

from __future__ import annotations

import numpy as np

from foldback.planner.arrays import Flags
from foldback.planner.shapes.shape import Shape


def extruded(cells: Flags, thickness: int, *, name: str) -> Shape:
    """Return the shape of a drawing, upright and seen from the front.

    Args:
        cells: (rows, columns) True for the cells, the top row first.
        thickness: Thickness in cells.
        name: Name of the shape.
    """
    rows, columns = np.nonzero(cells)
    layer = np.column_stack([columns, np.zeros_like(columns), cells.shape[0] - 1 - rows])
    layers = [layer + (0, depth, 0) for depth in range(thickness)]
    return Shape.from_cells(np.concatenate(layers), name=name)
