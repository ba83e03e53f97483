"""Snakes: paths through a box, back and forth, row by row and layer by layer."""

from __future__ import annotations

import numpy as np

from foldback.planner.arrays import Ints
from foldback.planner.shapes.shape import Shape


def is_box(shape: Shape) -> bool:
    """Return True if the cells fill their bounding box."""
    sides = shape.cells.max(axis=0) - shape.cells.min(axis=0) + 1
    return int(np.prod(sides)) == len(shape)


def snake_path(sides: tuple[int, int, int], *, axes: tuple[int, int, int] = (0, 1, 2)) -> Ints:
    """Return the (n, 3) cells of a box in an order in which each touches the next.

    Args:
        sides: Cells along x, y and z; the box begins at the origin.
        axes: Axis along the rows, axis along which a layer's rows are counted, and axis along
            which the layers are counted.
    """
    rows, lines, layers = (sides[axis] for axis in axes)
    index = np.arange(rows * lines * layers)
    line, along = np.divmod(index, rows)
    layer, across = np.divmod(line, lines)
    cells = np.empty((len(index), 3), dtype=np.int64)
    cells[:, axes[0]] = np.where(line % 2 == 0, along, rows - 1 - along)
    cells[:, axes[1]] = np.where(layer % 2 == 0, across, lines - 1 - across)
    cells[:, axes[2]] = layer
    return cells
