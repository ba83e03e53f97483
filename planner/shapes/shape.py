"""Shapes: sets of cubic cells, in no order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.chain.path import DEFAULT_PITCH_M, check_pitch, checked_cells
from planner.errors import InputError


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shape:
    """A set of cubic cells.

    Attributes:
        name: What people call it.
        cells: (n, 3) int64, read-only, unique, in lexicographic order (x first).
        pitch_m: Distance of neighbouring cells in metres.
        notes: Parts of the file that were left out, in plain words.
    """

    name: str
    cells: NDArray[np.int64]
    pitch_m: float = DEFAULT_PITCH_M
    notes: tuple[str, ...] = ()

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
        whole = np.unique(checked_cells(raw), axis=0)
        check_pitch(pitch_m)
        whole.setflags(write=False)
        return cls(name=name, cells=whole, pitch_m=float(pitch_m))

    def __len__(self) -> int:
        return len(self.cells)
