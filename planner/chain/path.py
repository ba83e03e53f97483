"""Paths: the order in which a chain visits the cells of a lattice."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from foldback.planner.arrays import Array, Flags, Ints
from foldback.planner.errors import InputError

MAX_COORDINATE: Final = 1_000_000
"""Maximum magnitude of a cell's coordinate in an input, in cells; a larger one is refused. It keeps
all arithmetic with cells exact."""
STEPS: Final = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
"""Displacements from a cell to its six neighbours, in cells; those with indices k and k ^ 1 are
opposite."""
MIN_CELLS: Final = 3
"""Minimum number of cells of a path for a chain: a shorter chain has no joint, and is refused."""
DEFAULT_PITCH_M: Final = 0.01
"""Distance between neighbouring modules, in m, for files that state none: one centimetre, as in the
published method."""
MIN_PITCH_M: Final = 1e-6
"""Smallest pitch of a path, m. A smaller one is refused: it most likely has another unit."""
MAX_PITCH_M: Final = 1000.0
"""Largest pitch of a path, m. A larger one is refused: it most likely has another unit."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Path:
    """A Hamiltonian path on cubic cells.

    Attributes:
        name: Name of the shape.
        cells: (n, 3) int64, read-only; consecutive cells share a face, none comes twice.
        pitch_m: Distance of neighbouring cells in metres.
    """

    name: str
    cells: Ints
    pitch_m: float = DEFAULT_PITCH_M

    @classmethod
    def from_cells(
        cls, cells: ArrayLike, *, name: str = "path", pitch_m: float = DEFAULT_PITCH_M
    ) -> Path:
        """Check cells and build a path of them.

        Args:
            cells: (n, 3) whole numbers in the order of the chain.
            name: Name of the shape.
            pitch_m: Distance of neighbouring cells in metres.

        Raises:
            InputError: Naming the cells that break the rule.
        """
        unique_cells = checked_cells(cells)
        check_pitch(pitch_m)
        _check_order(unique_cells)
        unique_cells.setflags(write=False)
        return cls(name=name, cells=unique_cells, pitch_m=float(pitch_m))

    def __len__(self) -> int:
        return len(self.cells)


def checked_cells(cells: ArrayLike) -> Ints:
    """Return (n, 3) whole numbers.

    Raises:
        InputError: ``not-cells`` for anything else, or naming the cell that is none.
    """
    raw = np.asarray(cells)
    if raw.ndim != 2 or raw.shape[1] != 3 or raw.dtype.kind not in "iuf":
        raise InputError(
            "not-cells",
            f"got an array of shape {raw.shape} and type {raw.dtype}, expected whole "
            "numbers in an array of shape (n, 3), one cell per row.",
        )
    values = raw.astype(np.float64)
    check_coordinates(
        values,
        (
            (~np.isfinite(values), "not-finite", "a whole number"),
            (values != np.round(values), "not-whole", "a whole number"),
            (
                np.abs(values) > MAX_COORDINATE,
                "too-far",
                f"−{MAX_COORDINATE} to {MAX_COORDINATE}; move the shape to the origin",
            ),
        ),
        row="cell",
    )
    return raw.astype(np.int64)


def check_coordinates(values: Array, rules: Iterable[tuple[Flags, str, str]], *, row: str) -> None:
    """Refuse the first coordinate that breaks a rule.

    Args:
        values: (n, 3) coordinates.
        rules: Rules: (n, 3) True where broken, code of the error, and expected value.
        row: Name of a row in the error.

    Raises:
        InputError: Naming the row.
    """
    for bad, code, expected in rules:
        if bad.any():
            index, column = (int(i) for i in np.argwhere(bad)[0])
            raise InputError(
                code,
                f"got {values[index, column]:g} for {'xyz'[column]}, expected {expected}.",
                where=f"{row} {index}",
            )


def check_pitch(pitch_m: float) -> None:
    """Refuse a pitch out of range.

    Raises:
        InputError: ``bad-pitch``.
    """
    if not MIN_PITCH_M <= pitch_m <= MAX_PITCH_M:
        raise InputError(
            "bad-pitch",
            f"got a pitch of {pitch_m} m, expected {MIN_PITCH_M} to {MAX_PITCH_M:g} m.",
        )


def _check_order(cells: Ints) -> None:
    if len(cells) < MIN_CELLS:
        raise InputError(
            "too-few-cells",
            f"got {len(cells)} cell{'' if len(cells) == 1 else 's'}, expected at least "
            f"{MIN_CELLS}; a shorter chain has no joint.",
        )
    first_visit: dict[tuple[int, ...], int] = {}
    for index, cell in enumerate(map(tuple, cells.tolist())):
        if cell in first_visit:
            raise InputError(
                "repeated-cell",
                "cells {cells} are both at {position}; a path visits each cell once.",
                where="cells {cells}",
                cells=[first_visit[cell], index],
                position=str(cell),
            )
        first_visit[cell] = index
    steps = np.abs(np.diff(cells, axis=0)).sum(axis=1)
    if (steps != 1).any():
        index = int(np.argmax(steps != 1))
        raise InputError(
            "not-adjacent",
            "cells {cells} are {steps} steps apart; consecutive cells must share a face.",
            where="cells {cells}",
            cells=[index, index + 1],
            steps=int(steps[index]),
        )
