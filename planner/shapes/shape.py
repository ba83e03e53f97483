"""Shapes: sets of cubic cells, in no order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.chain.path import DEFAULT_PITCH_M, LARGEST_COORDINATE
from planner.errors import InputError


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shape:
    """A set of cubic cells.

    Attributes:
        name: What people call it.
        cells: (n, 3) int64, read-only, unique, in lexicographic order (x first).
        pitch_m: Distance of neighbouring cells in metres.
    """

    name: str
    cells: NDArray[np.int64]
    pitch_m: float = DEFAULT_PITCH_M

    @classmethod
    def from_cells(
        cls, cells: ArrayLike, *, name: str = "shape", pitch_m: float = DEFAULT_PITCH_M
    ) -> Shape:
        """Checks cells and makes a shape of them; cells that come twice count once.

        Args:
            cells: (n, 3) whole numbers in any order.
            name: What people call the shape.
            pitch_m: Distance of neighbouring cells in metres.

        Raises:
            InputError: When there are none, or naming the cell that is no cell.
        """
        raw = np.asarray(cells)
        if raw.size == 0:
            raise InputError("empty", "got no cells, expected at least one.")
        if raw.ndim != 2 or raw.shape[1] != 3 or raw.dtype.kind not in "iuf":
            raise InputError(
                "not-cells",
                f"got an array of shape {raw.shape} and type {raw.dtype}, expected (n, 3) whole "
                "numbers: one cell a row.",
            )
        if not 0.0 < pitch_m <= 1000.0:
            raise InputError(
                "bad-pitch", f"got a pitch of {pitch_m} m, expected more than 0 and at most 1000."
            )
        _check_numbers(raw)
        whole = np.unique(raw.astype(np.int64), axis=0)
        whole.setflags(write=False)
        return cls(name=name, cells=whole, pitch_m=float(pitch_m))

    def __len__(self) -> int:
        return len(self.cells)


def _check_numbers(raw: NDArray[np.generic]) -> None:
    values = raw.astype(np.float64)
    for bad, code, expected in (
        (~np.isfinite(values), "not-finite", "a finite whole number"),
        (
            np.abs(values) > LARGEST_COORDINATE,
            "too-far",
            f"at most {LARGEST_COORDINATE} in size; move the shape to the origin",
        ),
        (values != np.round(values), "not-whole", "a whole number"),
    ):
        if bad.any():
            row, column = (int(i) for i in np.argwhere(bad)[0])
            raise InputError(
                code,
                f"got {values[row, column]:g} for {'xyz'[column]}, expected {expected}.",
                where=f"cell {row}",
            )
