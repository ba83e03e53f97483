"""Tetrahedron turns: the clear quarter turns of chains of tetrahedra, in the honeycomb."""

from __future__ import annotations

from typing import Final

import numpy as np

from planner.arrays import Ints
from planner.chain.chain import Chain
from planner.kernels.tetrahedron_turns import (
    TABLE_FULL,
    Moves,
    Scratch,
    TurningGaps,
    clear_turns,
    expand,
)
from planner.turns.turning import Children, Keys, Levels, Turning

QUARTER_RAD: Final = np.pi / 2
MIN_TABLE_ENTRIES: Final = 2**17
"""Number of slots of the table of turning gaps at first; it doubles when it is half full. Chains of
192 tetrahedra fill up to 35 000."""


class TetrahedronTurning(Turning):
    """Quarter turns of a chain of tetrahedra, see ``Turning``.

    A turn is clear if no two modules that are not linked come nearer than ``room`` to each other on
    the way. Two linked ones keep the gap between two cells while their hinge turns.

    Args:
        chain: The chain, in the honeycomb when folded.
        size: Module size as a fraction of the pitch.
    """

    def __init__(self, chain: Chain, size: float) -> None:
        module, modules = chain.module, len(chain)
        self.size = size
        self.cell_gap = 2.0 * module.inner_radius * (1.0 - size)
        self.step_rad = QUARTER_RAD
        self.folded = np.rint(chain.folded_rad / QUARTER_RAD).astype(np.int8)
        self._table = TurningGaps(
            keys=np.full(MIN_TABLE_ENTRIES, -1, np.int64),
            gaps=np.zeros(MIN_TABLE_ENTRIES, np.float32),
            used=np.zeros(1, np.int64),
            hull=module.hull,
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
        self._moves = _moves_for(0)

    def expand(
        self, states: Levels, keys: Keys, codes: Keys, *, room: float, weight: float
    ) -> Children:
        """Return all clear turns of some states, see ``Turning``."""
        most = 2 * states.size
        if len(self._moves.parent) < most:
            self._moves = _moves_for(most)
        moves = self._moves
        while True:
            count = expand(states, keys, codes, room, weight, self._table, self._scratch, moves)
            if count != TABLE_FULL:
                break
            self._table = _grown(self._table)
        return Children(
            parent=moves.parent[:count],
            hinge=moves.hinge[:count],
            level=moves.level[:count],
            score=moves.score[:count],
            key=moves.key[:count],
        )

    def pairs(self, state: Levels) -> Levels:
        """Return no states, see ``Turning``: single turns fold what is known to fold in turns."""
        return state[None][:0]

    def clear_turns(self, start: Levels, hinges: Ints, changes: Ints, *, room: float) -> int:
        """Return how many turns of a sequence are clear, one by one, see ``Turning``."""
        while True:
            count = clear_turns(start, hinges, changes, room, self._table, self._scratch)
            if count != TABLE_FULL:
                return count
            self._table = _grown(self._table)


def _grown(table: TurningGaps) -> TurningGaps:
    """Return an empty table of twice the size."""
    slots = 2 * len(table.keys)
    return table._replace(
        keys=np.full(slots, -1, np.int64),
        gaps=np.zeros(slots, np.float32),
        used=np.zeros(1, np.int64),
    )


def _moves_for(most: int) -> Moves:
    return Moves(
        parent=np.empty(most, np.int32),
        hinge=np.empty(most, np.int32),
        level=np.empty(most, np.int8),
        score=np.empty(most, np.float64),
        key=np.empty(most, np.uint64),
    )
