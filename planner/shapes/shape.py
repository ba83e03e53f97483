"""Shapes: sets of cubic cells, in no order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from foldback.planner.arrays import Ints
from foldback.planner.chain.path import DEFAULT_PITCH_M, check_pitch, checked_cells
from foldback.planner.errors import InputError

MAX_CELLS: Final = 200_000
"""Maximum number of cells, or of modules, of an input; one with more is refused."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shape:
    """A set of cubic cells.

    Attributes:
        name: Name of the shape.
        cells: (n, 3) int64, read-only, unique, in lexicographic order (x first).
        pitch_m: Distance of neighbouring cells in metres.
        notes: Messages about omitted parts of the file.
    """

    name: str
    cells: Ints
    pitch_m: float = DEFAULT_PITCH_M
    notes: tuple[str, ...] = ()

    @classmethod
    def from_cells(
        cls, cells: ArrayLike, *, name: str = "shape", pitch_m: float = DEFAULT_PITCH_M
    ) -> Shape:
        """Check cells and make a shape of them; repeated cells count once.

        Args:
            cells: (n, 3) whole numbers in any order.
            name: Name of the shape.
            pitch_m: Distance of neighbouring cells in metres.

        Raises:
            InputError: There are no cells, or one is invalid; names it.
        """
        raw = np.asarray(cells)
        if raw.size == 0:
            raise InputError("empty", "got no cells, expected at least one.")
        unique_cells = np.unique(checked_cells(raw), axis=0)
        check_pitch(pitch_m)
        unique_cells.setflags(write=False)
        return cls(name=name, cells=unique_cells, pitch_m=float(pitch_m))

    def __len__(self) -> int:
        return len(self.cells)
