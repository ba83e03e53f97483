"""Exact places of the prisms of a Rubik's snake on the cubic lattice.

A prism is half of a unit cube that is cut along a diagonal plane. With quarter turns, each prism
lies in one cell, and two prisms may share a cell only as its two complementary halves.

The frame of a prism has its origin at the centre of the cell: the chain enters through the face
x = −1/2 and leaves through the face y = −1/2, and the slanted face is x + y = 0. (A chain enters
every second prism of a real snake through what would be the other face in the frame of its mould;
the half turn about x = y, z = 0 maps the prism to itself and one face to the other, so that all
prisms are the same here.)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from foldback.planner.arrays import Ints
from foldback.planner.errors import InputError
from foldback.planner.twist_chains.snake_code import SnakeCode

PRISM_CORNERS: Final = np.array(
    [(x, y, z) for x, y in ((-1, -1), (1, -1), (-1, 1)) for z in (-1, 1)], dtype=np.int64
)
"""(6, 3) corners of a prism in its frame, in halves of a pitch."""
ENTRY: Final = np.array([-0.5, 0.0, 0.0])
"""(3,) centre of the face through which the chain enters a prism, in its frame, in pitches."""
_SLANT: Final = np.array([1, 1, 0], dtype=np.int64)
"""Normal of the slanted face in the prism's frame, out of the prism."""
_NEXT: Final = np.array([[0, -1, 0], [-1, 0, 0], [0, 0, -1]], dtype=np.int64)
"""Rotation from the frame of a prism to that of the next one in the rod."""
_QUARTER: Final = np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]], dtype=np.int64)
"""Quarter turn about the direction in which the chain leaves a prism, −y."""


@dataclass(frozen=True, slots=True, eq=False)
class SnakePlaces:
    """Places of the n prisms of a figure; the first one lies in the cell (0, 0, 0), upright.

    Attributes:
        cells: (n, 3) cells.
        rotations: (n, 3, 3) rotations from the frame of each prism to the lattice.
    """

    cells: Ints
    rotations: Ints

    @property
    def slants(self) -> Ints:
        """(n, 3) normals of the slanted faces, which point to the free halves of the cells."""
        return self.rotations @ _SLANT

    @property
    def corners(self) -> Ints:
        """(n, 6, 3) corners, in halves of a pitch; the centre of cell (0, 0, 0) is the origin."""
        return 2 * self.cells[:, None] + PRISM_CORNERS @ self.rotations.transpose(0, 2, 1)

    @property
    def bounding_cells(self) -> tuple[int, int, int]:
        """Numbers of cells along the axes of the smallest box that contains the figure."""
        x, y, z = np.ptp(self.cells, axis=0) + 1
        return int(x), int(y), int(z)

    def first_overlap(self) -> tuple[int, int] | None:
        """Return the first prism, along the chain, that lies in an earlier one: (earlier, later).

        None if no two prisms overlap.
        """
        halves: dict[tuple[int, ...], list[int]] = {}
        slants = self.slants
        for later, cell in enumerate(map(tuple, self.cells.tolist())):
            neighbours = halves.setdefault(cell, [])
            for earlier in neighbours:
                if (slants[earlier] + slants[later]).any():
                    return earlier, later
            neighbours.append(later)
        return None


def places_of(code: SnakeCode) -> SnakePlaces:
    """Return the places of the prisms of a figure; they may overlap."""
    turned, rotations = _lattice_turns()
    orientations = [0]
    for digit in code.digits:
        orientations.append(turned[orientations[-1]][digit])
    frames = rotations[orientations]
    cells = np.zeros((code.prisms, 3), dtype=np.int64)
    np.cumsum(-frames[:-1, :, 1], axis=0, out=cells[1:])
    return SnakePlaces(cells, frames)


def closing_digit(code: SnakeCode) -> int | None:
    """Return the digit of the joint that would link the last prism to the first one.

    None if the free faces of the two do not lie on each other.
    """
    places = places_of(code)
    last, rotation = places.cells[-1], places.rotations[-1]
    if (last - rotation[:, 1]).any():
        return None
    for digit in range(4):
        if (_rotation_behind(rotation, digit) == places.rotations[0]).all():
            return digit
    return None


def check_overlap(code: SnakeCode) -> None:
    """Refuse a figure in which prisms lie in one another.

    Raises:
        InputError: ``overlap``, naming the first two such prisms along the chain.
    """
    pair = places_of(code).first_overlap()
    if pair is not None:
        raise InputError(
            "overlap",
            "this figure cannot exist: prisms {modules} would lie in one another; check the digits "
            "of the joints between them.",
            where="prisms {modules}",
            modules=list(pair),
        )


def code_of_quarters(quarters: Ints) -> SnakeCode:
    """Return the code of a chain from its joint angles in whole quarter turns, of any sign."""
    return SnakeCode(tuple((np.asarray(quarters) % 4).tolist()))


def _rotation_behind(rotation: Ints, digit: int) -> Ints:
    """Return the rotation of the prism behind a joint."""
    return rotation @ np.linalg.matrix_power(_QUARTER, digit) @ _NEXT


@cache
def _lattice_turns() -> tuple[list[list[int]], Ints]:
    """Return numbers of the rotations behind each of 24 ones for each digit, and the rotations."""
    rotations = [np.eye(3, dtype=np.int64)]
    numbers = {rotations[0].tobytes(): 0}
    turned: list[list[int]] = []
    for rotation in rotations:  # grows while it is read
        row: list[int] = []
        for digit in range(4):
            behind = _rotation_behind(rotation, digit)
            number = numbers.setdefault(behind.tobytes(), len(rotations))
            if number == len(rotations):
                rotations.append(behind)
            row.append(number)
        turned.append(row)
    return turned, np.array(rotations)
