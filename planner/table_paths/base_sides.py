"""Base sides: sides on which a shape of cubes can lie, and margins of its balance."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Ints

MIN_BALANCE_MARGIN_PITCH: Final = 0.05
"""Minimum horizontal distance, in pitches, from a shape's centre of mass to the edge of the convex
hull of its cells on the table, so that the shape does not tip over."""
SIDE_ROTATIONS: Final = {
    "-z": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "+z": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    "-x": ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    "+x": ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
    "-y": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "+y": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
}
"""Rotation matrices (3, 3) from the frame of a shape as it stands to its frame when it lies on the
named side; ``-z`` leaves it as it stands."""
PLANE_SYMMETRIES: Final = tuple(
    np.array(turn, dtype=np.int64)
    for sign in (1, -1)
    for turn in (
        ((1, 0), (0, sign)),
        ((0, -1), (sign, 0)),
        ((-1, 0), (0, -sign)),
        ((0, 1), (-sign, 0)),
    )
)
"""The eight rotations and reflections, as (2, 2) matrices, of the table's plane that map the
lattice of cells to itself; paths that they map to each other count as the same."""


SIDE_NAMES: Final[dict[str, str]] = {
    "+x": "right",
    "-x": "left",
    "+y": "back",
    "-y": "front",
    "+z": "top",
    "-z": "bottom",
}
"""Names, for texts, of the sides on which a shape may lie on the table."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Side:
    """A shape that lies on one of its sides.

    Attributes:
        down: Side of the given shape that is down: ``-z``, ``+x`` and so on.
        turn: (3, 3) the rotation of the shape: a cell c lies at ``turn @ c + shift``.
        shift: (3,) shift of the turned shape to the origin, its lowest cells to z = 0.
        cells: (n, 3) lying cells, in the given order.
    """

    down: str
    turn: Ints
    shift: Ints
    cells: Ints


def sides_of(cells: Ints, *, turned: bool = True) -> Iterator[Side]:
    """Yield the sides on which a shape can lie, without those that look like an earlier one.

    Args:
        cells: (n, 3) distinct cells.
        turned: True for all sides, False for the one that is down.
    """
    images_seen: set[bytes] = set()
    for down, rows in SIDE_ROTATIONS.items():
        turn = np.array(rows, dtype=np.int64)
        laid = cells @ turn.T
        shift = -laid.min(axis=0)
        laid = laid + shift
        look = min(_sorted(image).tobytes() for image in images(laid))
        if look not in images_seen:
            images_seen.add(look)
            yield Side(down=down, turn=turn, shift=shift, cells=laid)
        if not turned:
            return


def images(cells: Ints) -> Iterator[Ints]:
    """Yield the eight images of cells under turns and mirrors about the vertical, at the origin."""
    for turn in PLANE_SYMMETRIES:
        image = np.column_stack([cells[:, :2] @ turn.T, cells[:, 2]])
        yield image - image.min(axis=0)


def support(floor: Ints) -> Array:
    """Return the (E, 3) edges of the floor cells' hull: a, b, c; a x + b y + c ≤ 0 inside."""
    from scipy.spatial import ConvexHull  # late: most folds need no table

    corners = (floor[:, None, :2] + np.array(list(product((-0.5, 0.5), repeat=2)))).reshape(-1, 2)
    return np.asarray(ConvexHull(corners).equations, dtype=np.float64)


def margins_within(edges: Array, points: Array) -> Array:
    """Return (k,) distances of (k, 2) points from a hull's rim, pitches; negative outside."""
    return -(points @ edges[:, :2].T + edges[:, 2]).max(axis=1)


def stands(cells: Ints) -> float:
    """Return the margin of the centre of mass in the hull of the cells at z = 0, pitches."""
    centre = cells[:, :2].mean(axis=0, keepdims=True)
    return float(margins_within(support(cells[cells[:, 2] == 0]), centre)[0])


def prefix_margins(order: Ints) -> Array:
    """Return (n,) ``stands`` of the first 1 … n cells of a path; −inf without floor cells."""
    count = len(order)
    centres = np.cumsum(order[:, :2], axis=0) / np.arange(1, count + 1)[:, None]
    on_floor = order[:, 2] == 0
    margins = np.full(count, -np.inf)
    starts = [*np.flatnonzero(on_floor).tolist(), count]
    for first, following in zip(starts, starts[1:], strict=False):
        edges = support(order[: first + 1][on_floor[: first + 1]])
        margins[first:following] = margins_within(edges, centres[first:following])
    return margins


def _sorted(cells: Ints) -> Ints:
    return cells[np.lexsort(cells.T[::-1])]
