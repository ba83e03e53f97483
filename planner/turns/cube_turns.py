"""Cube turns: the clear quarter turns of chains of cubes, from an exact table of swept cells."""

from __future__ import annotations

from typing import Final

import numpy as np

from planner.arrays import Flags, Ints
from planner.chain.chain import Chain
from planner.kernels import Levels
from planner.kernels.cube_turns import (
    BORDER,
    Scratch,
    SweptCells,
    clear_turns,
    count_contacts,
    test_turns,
    without_overlaps,
)
from planner.turns.turning import Turning

MIN_TABLE_ENTRIES: Final = 2**16
"""Number of entries for which a table of swept cells has room at first; it doubles when full."""


class CubeTurning(Turning):
    """Quarter turns of a chain of cubes on the lattice, see ``Turning``.

    A turn is clear if no two modules that are not exempt come nearer than ``room`` to each other on
    the way. Cubes that turn about a lattice axis stay in their layers, where the distance of two
    squares is known in closed form (``planner.kernels.cube_turns.turning_gap``).
    """

    width = 4

    def __init__(self, chain: Chain, size: float) -> None:
        super().__init__(chain, size)
        modules = len(chain)
        radius = modules // 2 + 2  # the shorter part of the chain reaches no farther
        self._table = SweptCells(
            start=np.full((radius, radius), -1, np.int32),
            stop=np.zeros((radius, radius), np.int32),
            cells=np.empty((MIN_TABLE_ENTRIES, 2), np.int16),
            gaps=np.empty(MIN_TABLE_ENTRIES, np.float32),
            used=np.zeros(1, np.int64),
            half=0.5 * size,
            reach=1.0 - size,
        )
        self._scratch = Scratch(
            cells=np.zeros((modules, 3), np.int64),
            axes=np.zeros((modules, 3, 3), np.int64),
            # The extents of a chain's box add up to at most its length and 2 for the corners.
            grid=np.zeros(((modules + 4) // 3 + 2 * BORDER) ** 3, np.int16),
            contacts=np.zeros(modules, np.int64),
            nearest=np.zeros(modules + 2 * BORDER),
            farthest=np.zeros(modules + 2 * BORDER),
        )

    def _count_contacts(self, state: Levels, contacts: Ints) -> None:
        count_contacts(state, self._scratch, contacts)

    def _test_turns(
        self, state: Levels, hinges: Ints, changes: Ints, room: float, clear: Flags
    ) -> int:
        return test_turns(state, hinges, changes, room, self._table, self._scratch, clear)

    def _clear_turns(self, start: Levels, hinges: Ints, changes: Ints, room: float) -> int:
        return clear_turns(start, hinges, changes, room, self._table, self._scratch)

    def _without_overlaps(self, states: Levels) -> Flags:
        return without_overlaps(states, self._scratch)

    def _grow_table(self) -> None:
        table = self._table
        self._table = table._replace(
            cells=np.concatenate([table.cells, np.empty_like(table.cells)]),
            gaps=np.concatenate([table.gaps, np.empty_like(table.gaps)]),
        )
