"""Cube turns: the clear quarter turns of chains of cubes, from an exact table of swept cells."""

from __future__ import annotations

from typing import Final

import numpy as np

from planner.arrays import Ints
from planner.chain.chain import Chain
from planner.kernels.cube_turns import (
    TABLE_FULL,
    Moves,
    Scratch,
    SweptCells,
    clear_turns,
    expand,
    without_overlaps,
)
from planner.turns.turning import Children, Keys, Levels, Turning

QUARTER_RAD: Final = np.pi / 2
MIN_TABLE_ENTRIES: Final = 2**16
"""Number of entries for which a table of swept cells has room at first; it doubles
when full."""


class CubeTurning(Turning):
    """Quarter turns of a chain of cubes, see ``Turning``.

    A turn is clear if no two modules that are not exempt come nearer than ``room`` to each other on
    the way. Cubes that turn about a lattice axis stay in their layers, where the distance of two
    squares is known in closed form (``planner.kernels.cube_turns.turning_gap``).

    Args:
        chain: The chain, on the lattice when folded.
        size: Module size as a fraction of the pitch.
    """

    def __init__(self, chain: Chain, size: float) -> None:
        self.size = size
        self.cell_gap = 1.0 - size
        self.step_rad = QUARTER_RAD
        self.folded = np.rint(chain.folded_rad / QUARTER_RAD).astype(np.int8)
        modules = len(chain)
        self._table = _empty_table(modules, size)
        self._scratch = Scratch(
            cells=np.zeros((modules, 3), np.int64),
            axes=np.zeros((modules, 3, 3), np.int64),
            # The extents of a chain's box add up to at most its length and 2 for the corners.
            grid=np.zeros((modules // 3 + 2) ** 3, np.int16),
            contacts=np.zeros(modules, np.int64),
            nearest=np.zeros(modules + 2),
            farthest=np.zeros(modules + 2),
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
        """Return states with two more straight hinges, without overlaps, see ``Turning``."""
        bent = np.flatnonzero(state)
        first, second = np.triu_indices(len(bent), 1)
        order = np.argsort(bent[second] - bent[first], kind="stable")
        pairs = np.stack([bent[first], bent[second]], axis=1)[order]
        states = np.repeat(state[None], len(pairs), axis=0)
        np.put_along_axis(states, pairs, 0, axis=1)
        return states[without_overlaps(states, self._scratch)]

    def clear_turns(self, start: Levels, hinges: Ints, changes: Ints, *, room: float) -> int:
        """Return how many turns of a sequence are clear, one by one, see ``Turning``."""
        while True:
            count = clear_turns(start, hinges, changes, room, self._table, self._scratch)
            if count != TABLE_FULL:
                return count
            self._table = _grown(self._table)


def _empty_table(modules: int, size: float) -> SweptCells:
    """Return a table without rows, for offsets within the shorter part of a chain."""
    radius = modules // 2 + 2
    return SweptCells(
        start=np.full((radius, radius), -1, np.int32),
        stop=np.zeros((radius, radius), np.int32),
        cells=np.empty((MIN_TABLE_ENTRIES, 2), np.int16),
        gaps=np.empty(MIN_TABLE_ENTRIES, np.float32),
        used=np.zeros(1, np.int64),
        half=0.5 * size,
        reach=1.0 - size,
    )


def _grown(table: SweptCells) -> SweptCells:
    """Return a table with twice the room."""
    return table._replace(
        cells=np.concatenate([table.cells, np.empty_like(table.cells)]),
        gaps=np.concatenate([table.gaps, np.empty_like(table.gaps)]),
    )


def _moves_for(most: int) -> Moves:
    return Moves(
        parent=np.empty(most, np.int32),
        hinge=np.empty(most, np.int32),
        level=np.empty(most, np.int8),
        score=np.empty(most, np.float64),
        key=np.empty(most, np.uint64),
    )
