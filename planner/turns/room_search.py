"""Room search: the moves that unfold a chain, with as much room as can be found."""

from __future__ import annotations

from typing import Final

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.core.structures import Levels
from foldback.planner.progress import Cancelled, never
from foldback.planner.turns.beam_search import Unfolded, unfold
from foldback.planner.turns.moves import RoomProof
from foldback.planner.turns.turning import Turning

ROOM_SHARES: Final = (0.9, 0.45, 0.35, 0.09, 0.01)
"""Distances that modules must keep while they turn, as fractions of the gap between two cells; the
first with which a sequence is found is taken. At a module size of 0.95 the largest is 0.045 pitch,
about the clearance of an explosion."""


class RoomSearch:
    """Search for the moves that unfold a chain, with less and less room until one succeeds.

    Args:
        chain: The chain.
        turning: Its turns.
        pairs: True if two hinges may turn at once where no single one leads on.
        roomy: True to search with the most room alone.
        seed: Seed of the search.
        cancelled: Polled before each turn.

    Attributes:
        room: Distance that modules keep while they move, pitches.
        expanded: Number of states whose turns were tried.
    """

    def __init__(
        self,
        chain: Chain,
        turning: Turning,
        *,
        pairs: bool,
        roomy: bool,
        seed: int,
        cancelled: Cancelled = never,
    ) -> None:
        self.room = 0.0
        self.expanded = 0
        self._chain = chain
        self._turning = turning
        self._pairs = pairs
        self._roomy = roomy
        self._seed = seed
        self._cancelled = cancelled

    def unfold(self) -> Unfolded:
        """Return the first search that succeeds, or the one that got farthest."""
        farthest: Unfolded | None = None
        attempts = [(share, self._turning.width) for share in ROOM_SHARES]
        attempts.append((ROOM_SHARES[-1], 16))
        for share, width in attempts[:1] if self._roomy else attempts:
            self.room = share * self._turning.cell_gap
            search = self._from(self._turning.folded[None], width)
            if self._pairs:
                search = self._with_pairs(search)
            if search.outcome in ("straight", "cancelled"):
                return search
            if farthest is None or _bent(search) <= _bent(farthest):
                farthest = search
        assert farthest is not None
        return farthest

    def _from(self, states: Levels, width: int) -> Unfolded:
        """Return a search that goes on from the last of some states."""
        search = unfold(
            self._turning,
            states[-1],
            room=self.room,
            width=width,
            seed=self._seed,
            cancelled=self._cancelled,
        )
        self.expanded += search.expanded
        if len(states) == 1:
            return search
        outcome = "stuck" if search.outcome == "blocked" else search.outcome
        joined = np.concatenate([states[:-1], search.states])
        return Unfolded(outcome=outcome, states=joined, expanded=search.expanded)

    def _with_pairs(self, search: Unfolded) -> Unfolded:
        """Return a search that goes on where one has ended, by turning two hinges at once there."""
        proof = RoomProof(self._chain, self._turning, self.room)
        for _ in range(6):
            if search.outcome in ("straight", "cancelled"):
                break
            farthest, pairs_tried, checked = search, 0, 0
            for pair in self._turning.pairs(search.states[-1]):
                checked += 1
                # With 400 pairs instead of 2000, the mallet of 160 cubes keeps 9 % of the gap
                # between two cells instead of 90 %.
                if checked > 2000 or pairs_tried >= 4 or self._cancelled():
                    break
                motion = search.states[-1], pair
                if not (proof.seems_clear(*motion, sample_gap=0.0) and proof.at_once(*motion)):
                    continue
                pairs_tried += 1
                further = self._from(np.concatenate([search.states, pair[None]]), 4)
                if further.outcome in ("straight", "cancelled"):
                    return further
                if _bent(further) < _bent(farthest):
                    farthest = further
            if farthest is search:
                break
            search = farthest
        return search


def _bent(search: Unfolded) -> int:
    """Return the number of bent hinges where a search has ended."""
    return int(np.count_nonzero(search.states[-1]))
