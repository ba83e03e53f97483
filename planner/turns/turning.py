"""Turning: what a search for turns needs to know of a kind of modules."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from planner.arrays import Array, Ints

Levels = NDArray[np.int8]
Keys = NDArray[np.uint64]


class Children(NamedTuple):
    """Clear turns of some states.

    Attributes:
        parent: (M,) number of the state that turns.
        hinge: (M,) hinge that turns.
        level: (M,) its level after the turn.
        score: (M,) score of the new state, the lower the better; 0 if all hinges are straight.
        key: (M,) key of the new state.
    """

    parent: NDArray[np.int32]
    hinge: NDArray[np.int32]
    level: NDArray[np.int8]
    score: Array
    key: Keys


class Turning(Protocol):
    """Turns by one level of one hinge of a chain, with the shorter part as a rigid body.

    A state has one level for each hinge: −1, 0 or 1 times ``step_rad``.

    Attributes:
        folded: (J,) levels of the folded chain.
        step_rad: Angle of a turn, rad.
        size: Module size as a fraction of the pitch.
        cell_gap: Gap between modules in neighbouring cells, pitches.
    """

    folded: Levels
    step_rad: float
    size: float
    cell_gap: float

    def expand(
        self, states: Levels, keys: Keys, codes: Keys, *, room: float, weight: float
    ) -> Children:
        """Return all clear turns of some states; valid until the next call.

        Args:
            states: (B, J) levels.
            keys: (B,) key of each state.
            codes: (J, 3) random bits of each level of each hinge; the key of a state is the
                exclusive or of those of its levels.
            room: Distance that modules must keep, pitches.
            weight: Weight of a pair of touching modules in the score; a bent hinge counts 1.
        """
        ...

    def pairs(self, state: Levels) -> Levels:
        """Return states that differ from one in two hinges that get straight, without overlaps.

        Args:
            state: (J,) levels.

        Returns:
            (M, J) levels, those of hinges that are near each other along the chain first.
        """
        ...

    def clear_turns(self, start: Levels, hinges: Ints, changes: Ints, *, room: float) -> int:
        """Return the number of turns before the first that is not clear.

        Args:
            start: (J,) levels before the first turn.
            hinges, changes: (T,) hinge of each turn, and −1 or 1.
            room: Distance that modules must keep, pitches.
        """
        ...
