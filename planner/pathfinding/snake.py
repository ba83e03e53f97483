"""Snakes: row by row and layer by layer, back and forth, the way through a box."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.shapes.shape import Shape

Ints = NDArray[np.int64]


def is_box(shape: Shape) -> bool:
    """Whether the cells fill their bounding box."""
    sides = shape.cells.max(axis=0) - shape.cells.min(axis=0) + 1
    return int(np.prod(sides)) == len(shape)


def snake_path(sides: tuple[int, int, int], *, axes: tuple[int, int, int] = (0, 1, 2)) -> Ints:
    """(n, 3) cells of a box in an order where each touches the next.

    Args:
        sides: Cells along x, y and z; the box begins at the origin.
        axes: Which axis the rows run along, which one a layer's rows are counted along, and which
            one the layers are counted along.
    """
    rows, lines, layers = (sides[axis] for axis in axes)
    index = np.arange(rows * lines * layers)
    line, along = np.divmod(index, rows)
    layer, across = np.divmod(line, lines)
    found = np.empty((len(index), 3), dtype=np.int64)
    found[:, axes[0]] = np.where(line % 2 == 0, along, rows - 1 - along)
    found[:, axes[1]] = np.where(layer % 2 == 0, across, lines - 1 - across)
    found[:, axes[2]] = layer
    return found
