"""Sequences of the pieces of a snake cube: cubes on a cord, straight ones and corners."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from foldback.planner.errors import InputError

NOTATIONS: Final = ("cube", "letters", "runs", "legs", "run-and-legs")
"""Names of the notations in which a sequence can be read and written."""
MIN_PIECES: Final = 2
"""Minimum number of cubes of a snake cube."""


@dataclass(frozen=True, slots=True)
class CubeSequence:
    """Pieces of a snake cube, from one end to the other.

    Attributes:
        corners: True for each cube inside which the cord turns by 90°, False for straight cubes
            and for those at the ends.
    """

    corners: tuple[bool, ...]

    def __post_init__(self) -> None:
        """Raise InputError if there are too few pieces, or if an end is a corner."""
        if len(self.corners) < MIN_PIECES:
            raise InputError(
                "wrong-count", f"got {len(self.corners)} pieces, expected at least {MIN_PIECES}."
            )
        for name, index in (("first", 0), ("last", -1)):
            if self.corners[index]:
                raise InputError(
                    "corner-at-end",
                    f"the {name} piece is a corner, but the cord ends there; write 0 for it.",
                )

    def __len__(self) -> int:
        """Return the number of cubes."""
        return len(self.corners)

    @property
    def corner_count(self) -> int:
        """Number of corners."""
        return sum(self.corners)

    @property
    def legs(self) -> tuple[int, ...]:
        """Numbers of steps from cube to cube between an end or corner and the next one."""
        ends = [0, *(i for i, corner in enumerate(self.corners) if corner), len(self) - 1]
        return tuple(after - before for before, after in pairwise(ends))

    def from_other_end(self) -> CubeSequence:
        """Return the sequence of the same snake, read from the last cube to the first."""
        return CubeSequence(self.corners[::-1])

    def text(self, notation: str = "cube") -> str:
        """Return the sequence in one of the ``NOTATIONS``.

        ``cube``: a digit for each cube, 1 for a corner; ``letters``: E, S and C for ends, straight
        cubes and corners; ``runs``: numbers of cubes in each straight run, corners counted in both
        runs; ``legs``: numbers of steps in each; ``run-and-legs``: cubes in the first, steps in
        all others.
        """
        match notation:
            case "cube":
                return "".join("01"[corner] for corner in self.corners)
            case "letters":
                return f"E{''.join('SC'[corner] for corner in self.corners[1:-1])}E"
            case "runs":
                return ",".join(str(leg + 1) for leg in self.legs)
            case "legs":
                return ",".join(map(str, self.legs))
            case _:
                first, *others = self.legs
                return ",".join(map(str, (first + 1, *others)))


def sequence_of_legs(legs: tuple[int, ...]) -> CubeSequence:
    """Return the sequence with so many steps between each end or corner and the next one.

    Args:
        legs: At least one number, all positive.
    """
    corners = [False]
    for leg in legs:
        corners.extend([False] * (leg - 1) + [True])
    corners[-1] = False
    return CubeSequence(tuple(corners))
