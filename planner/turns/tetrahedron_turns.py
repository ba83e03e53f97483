"""Tetrahedron turns: the clear quarter turns of chains of tetrahedra, in the honeycomb."""

from __future__ import annotations

from typing import Final

import numpy as np

from planner.arrays import Flags, Ints
from planner.chain.chain import Chain
from planner.kernels import Levels
from planner.kernels.tetrahedron_turns import (
    Scratch,
    TurningGaps,
    clear_turns,
    count_contacts,
    test_turns,
    without_overlaps,
)
from planner.turns.turning import Turning

MIN_TABLE_ENTRIES: Final = 2**17
"""Number of slots of the table of turning gaps at first; it doubles when it is half full. Chains of
192 tetrahedra fill up to 35 000."""


class TetrahedronTurning(Turning):
    """Quarter turns of a chain of tetrahedra in the honeycomb, see ``Turning``.

    A turn is clear if no two modules that are not linked come nearer than ``room`` to each other on
    the way. Two linked ones keep the gap between two cells while their hinge turns.
    """

    width = 1

    def __init__(self, chain: Chain, size: float) -> None:
        super().__init__(chain, size)
        modules = len(chain)
        self._table = TurningGaps(
            keys=np.full(MIN_TABLE_ENTRIES, -1, np.int64),
            gaps=np.zeros(MIN_TABLE_ENTRIES, np.float32),
            used=np.zeros(1, np.int64),
            hull=chain.module.hull,
            size=float(size),
            reach=self.cell_gap,
        )
        slots = 4 << modules.bit_length()
        self._scratch = Scratch(
            nodes=np.zeros((modules + 1, 3), np.int64),
            axes=np.zeros((modules, 3), np.int64),
            seen=np.zeros((modules, 3), np.int64),
            cells=np.full(slots, -1, np.int64),
            modules=np.zeros(slots, np.int32),
            contacts=np.zeros(modules, np.int64),
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
        slots = 2 * len(self._table.keys)
        self._table = self._table._replace(
            keys=np.full(slots, -1, np.int64),
            gaps=np.zeros(slots, np.float32),
            used=np.zeros(1, np.int64),
        )
