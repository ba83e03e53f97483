"""Coarse drawing: the cells that are most like a silhouette of many pixels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Flags
from foldback.planner.errors import InputError
from foldback.planner.shapes.bridges import parts_of

MAX_SIDE_CELLS: Final = 240
"""Maximum number of cells along one side of a drawing; more are refused."""
SCALES: Final = (0.92, 0.96, 1.0, 1.04, 1.08)
"""Sizes of a silhouette that are tried, as multiples of the size of the requested area."""
SHIFTS: Final = (0.0, 0.5, 0.25, 0.75)
"""Distances of the silhouette's middle from a border of cells that are tried, in cells. With the
first two, a symmetric silhouette gets a symmetric drawing."""
SHARES: Final = (0.35, 0.5)
"""Smallest shares of a cell inside the silhouette for the cell to be filled that are tried. The
lower one keeps thin strokes."""
FEATURE_COST: Final = 0.05
"""Loss of overlap that one hole or part too many or too few counts as, in the choice among
drawings."""
SYMMETRY_COST: Final = 0.3
"""Loss of overlap that the loss of mirror symmetry counts as, for all cells."""
MIN_FEATURE_SHARE: Final = 0.004
"""Minimum share of a silhouette's box of a hole that counts."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CoarseDrawing:
    """A silhouette, drawn in cells.

    Attributes:
        cells: (rows, columns) True for its cells, cropped to them.
        shared: Area that cells and silhouette share, in cells.
        area: Area of the silhouette, in cells.
    """

    cells: Flags
    shared: float
    area: float

    @property
    def overlap(self) -> float:
        """Intersection over union of cells and silhouette."""
        return self.shared / (float(self.cells.sum()) + self.area - self.shared)


def coarse_drawing(silhouette: Flags, cells: int) -> CoarseDrawing:
    """Return the drawing in about so many cells that is most like a silhouette.

    Sizes and positions on the grid are tried. The overlap decides, less for each hole or part that
    appears or vanishes.

    Args:
        silhouette: (rows, columns) pixels, cropped to the silhouette.
        cells: Requested number of cells.

    Raises:
        InputError: ``too-long`` when so many cells make a side that is too long.
    """
    pitch = float(np.sqrt(silhouette.sum() / max(1, cells)))
    if max(silhouette.shape) > pitch * MAX_SIDE_CELLS:
        raise InputError(
            "too-long",
            f"the picture would be more than {MAX_SIDE_CELLS} cells long with so many modules; "
            "request fewer modules, or draw thicker lines.",
        )
    sums = np.pad(np.cumsum(np.cumsum(silhouette, axis=0, dtype=np.float64), axis=1), ((1, 0),) * 2)
    wanted, symmetry = _features(silhouette), _symmetry(silhouette)
    best: tuple[float, CoarseDrawing] | None = None
    for drawing in _drawings(sums, pitch):
        parts, holes = _features(drawing.cells)
        excess = abs(float(drawing.cells.sum()) / cells - 1.0)
        score = drawing.overlap - max(0.0, excess - 0.1)
        score -= FEATURE_COST * (abs(parts - wanted[0]) + abs(holes - wanted[1]))
        score -= SYMMETRY_COST * max(0.0, symmetry - _symmetry(drawing.cells))
        if best is None or score > best[0] + 1e-9:
            best = score, drawing
    assert best is not None
    return best[1]


def _drawings(sums: Array, pitch: float) -> Iterator[CoarseDrawing]:
    """Yield drawings of different sizes and positions, cropped to their cells; at least one."""
    for scale, down, right in product(SCALES, SHIFTS, SHIFTS):
        cover = _cover(sums, pitch * scale, down, right)
        for share in SHARES:
            cells = cover >= min(share, float(cover.max()))
            rows, columns = np.flatnonzero(cells.any(axis=1)), np.flatnonzero(cells.any(axis=0))
            yield CoarseDrawing(
                cells=cells[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1],
                shared=float(cover[cells].sum()),
                area=float(cover.sum()),
            )


def _cover(sums: Array, pitch: float, down: float, right: float) -> Array:
    """Return the (rows, columns) share of each cell that is inside the silhouette.

    Args:
        sums: (rows + 1, columns + 1) number of inside pixels above and left of each corner.
        pitch: Side of a cell, in pixels.
        down, right: Distance of its middle from a border of cells, in cells.
    """
    rows = _corner_sums(sums, pitch, down)
    corners = _corner_sums(rows.T, pitch, right).T
    return np.diff(np.diff(corners, axis=0), axis=1) / pitch**2


def _corner_sums(sums: Array, pitch: float, shift: float) -> Array:
    """Return sums at the borders of cells along the first axis, interpolated between pixels."""
    last = len(sums) - 1
    first = (last / 2.0 / pitch + shift) % 1.0  # part of a cell before the first border
    count = int(np.ceil(last / pitch + 1.0 - first))
    borders = np.clip(pitch * (np.arange(count + 1) + first - 1.0), 0.0, float(last))
    low = np.minimum(borders.astype(np.int64), last - 1)
    part = (borders - low)[:, None]
    return (1.0 - part) * sums[low] + part * sums[low + 1]


def _features(cells: Flags) -> tuple[int, int]:
    """Return the numbers of parts and of holes that are large enough to count."""
    padded = np.pad(cells, 1)
    _, hole_sizes = parts_of(~padded)
    large = int((hole_sizes >= MIN_FEATURE_SHARE * cells.size).sum())
    _, part_sizes = parts_of(padded)
    return len(part_sizes), large - 1


def _symmetry(cells: Flags) -> float:
    """Return the share of cells whose mirror image, left for right, is a cell as well."""
    return float((cells & cells[:, ::-1]).sum()) / float(cells.sum())
