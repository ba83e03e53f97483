"""Resting: the sides that a shape of cubes can lie on, and how safely cells stand on the floor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

Ints = NDArray[np.int64]
Array = NDArray[np.float64]

SAFE: Final = 0.05
"""How far within the hull of the floor cells the centre of mass has to be, in pitches."""
CORNERS: Final = np.array(list(product((-0.5, 0.5), repeat=2)))
TURNS: Final = {
    "-z": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "+z": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    "-x": ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    "+x": ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
    "-y": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "+y": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
}
"""Rotations that lay a side of a shape down; ``-z`` leaves it as it stands."""
ABOUT: Final = tuple(
    np.array(turn, dtype=np.int64)
    for sign in (1, -1)
    for turn in (
        ((1, 0), (0, sign)),
        ((0, -1), (sign, 0)),
        ((-1, 0), (0, -sign)),
        ((0, 1), (-sign, 0)),
    )
)
"""The eight rotations and mirrors of the plane that map the lattice to itself."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Side:
    """A shape that lies on one of its sides.

    Attributes:
        down: The side of the shape as it was given that is down: ``-z``, ``+x`` and so on.
        turn: (3, 3) the rotation of the shape: a cell c lies at ``turn @ c + shift``.
        shift: (3,) what moves the turned shape to the origin, its lowest cells to z = 0.
        cells: (n, 3) the cells as they lie, in the order in which they were given.
    """

    down: str
    turn: Ints
    shift: Ints
    cells: Ints


def sides_of(cells: Ints, *, turned: bool = True) -> Iterator[Side]:
    """The sides that a shape can be laid on, those left out that look as one before.

    Args:
        cells: (n, 3) distinct cells.
        turned: Also other sides than the one that is down.
    """
    seen: set[bytes] = set()
    for down, rows in TURNS.items():
        turn = np.array(rows, dtype=np.int64)
        laid = cells @ turn.T
        shift = -laid.min(axis=0)
        laid = laid + shift
        look = min(_sorted(image).tobytes() for image in images(laid))
        if look not in seen:
            seen.add(look)
            yield Side(down=down, turn=turn, shift=shift, cells=laid)
        if not turned:
            return


def images(cells: Ints) -> Iterator[Ints]:
    """Cells turned and mirrored about the vertical in all eight ways, moved to the origin."""
    for turn in ABOUT:
        image = np.column_stack([cells[:, :2] @ turn.T, cells[:, 2]])
        yield image - image.min(axis=0)


def support(floor: Ints) -> Array:
    """(E, 3) the edges of the hull of floor cells: a, b, c with a x + b y + c ≤ 0 inside."""
    corners = (floor[:, None, :2] + CORNERS).reshape(-1, 2)
    return np.asarray(ConvexHull(corners).equations, dtype=np.float64)


def margins_within(edges: Array, points: Array) -> Array:
    """(k,) how far (k, 2) points lie within a hull, in pitches; negative outside."""
    return -(points @ edges[:, :2].T + edges[:, 2]).max(axis=1)


def stands(cells: Ints) -> float:
    """How far the centre of mass lies within the hull of the cells at z = 0, in pitches."""
    centre = cells[:, :2].mean(axis=0, keepdims=True)
    return float(margins_within(support(cells[cells[:, 2] == 0]), centre)[0])


def prefix_margins(order: Ints) -> Array:
    """(n,) ``stands`` of the first 1, 2 … n cells of a path; −inf where none is on the floor."""
    count = len(order)
    centres = np.cumsum(order[:, :2], axis=0) / np.arange(1, count + 1)[:, None]
    on_floor = order[:, 2] == 0
    found = np.full(count, -np.inf)
    starts = [*np.flatnonzero(on_floor).tolist(), count]
    for first, following in zip(starts, starts[1:], strict=False):
        edges = support(order[: first + 1][on_floor[: first + 1]])
        found[first:following] = margins_within(edges, centres[first:following])
    return found


def _sorted(cells: Ints) -> Ints:
    return cells[np.lexsort(cells.T[::-1])]
