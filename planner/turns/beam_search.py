"""Beam search: a sequence of single turns that unfolds a chain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from foldback.planner.arrays import Ints
from foldback.planner.core.structures import Levels
from foldback.planner.progress import Cancelled, never
from foldback.planner.turns.turning import Keys, Turning, Turns

CONTACT_WEIGHT: Final = 0.5
"""Weight of a pair of touching modules in the score of a state; a bent hinge counts 1. With 0.5 all
14 gallery shapes of a first trial were unfolded. Measured from 0.35 to 0.7: equally good (decision
0051)."""

Outcome = Literal["straight", "blocked", "stuck", "cancelled"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Unfolded:
    """Result of a search.

    Attributes:
        outcome: ``straight`` if a sequence was found; ``blocked`` if no hinge can turn in the
            folded state; ``stuck`` if no state in the beam led on.
        states: (T + 1, J) levels from the start to the best state: the straight one if the search
            succeeded.
        expanded: Number of states whose turns were tried.
    """

    outcome: Outcome
    states: Levels
    expanded: int


class _Trail:
    """The turns by which the states of a beam were reached."""

    def __init__(self) -> None:
        self._turns: list[tuple[Ints, Ints, Levels]] = []

    def add(self, parent: Ints, hinge: Ints, before: Levels) -> None:
        """Add a turn of each state: its state before, its hinge, and the level of that before."""
        self._turns.append((parent, hinge, before))

    def to(self, state: Levels, at: int) -> Levels:
        """Return the states from the first one to the state with this place in the beam."""
        states = [state]
        for parent, hinge, before in reversed(self._turns):
            earlier = states[-1].copy()
            earlier[hinge[at]] = before[at]
            states.append(earlier)
            at = int(parent[at])
        return np.array(states[::-1])


def unfold(
    turning: Turning,
    start: Levels,
    *,
    room: float,
    width: int,
    seed: int,
    cancelled: Cancelled = never,
) -> Unfolded:
    """Search for turns from a state to straight: fewest bent hinges and contacts first.

    Args:
        turning: Turns of the chain.
        start: (J,) levels at first.
        room: Distance that modules must keep, pitches.
        width: Number of states that are kept after each turn.
        seed: Seed of the order of equal states.
        cancelled: Polled before each turn.
    """
    hinges = np.arange(len(start))
    random = np.random.default_rng(seed)
    codes = random.integers(0, 2**64, (len(start), 3), np.uint64)
    beam = start[None].copy()
    keys: Keys = np.bitwise_xor.reduce(codes[hinges, start + 1])[None]
    visited = set(keys.tolist())
    trail, expanded, lowest, since = _Trail(), 0, np.inf, 0
    nearest = beam[:1]
    while beam.any(axis=1).all():
        if cancelled():
            return Unfolded(outcome="cancelled", states=trail.to(beam[0], 0), expanded=expanded)
        turns = turning.turns(beam, keys, codes, weight=CONTACT_WEIGHT)
        expanded += len(beam)
        # less than the difference of two scores, 0.5
        order = np.argsort(turns.score + 0.3 * random.random(len(turns.score)))
        accepted = _first_clear(turning, beam, turns, order, visited, room=room, count=width)
        score = float(turns.score[accepted].min(initial=np.inf))
        improves = score < lowest
        since = 0 if improves else since + 1
        lowest = min(lowest, score)
        if since > 24 or not len(accepted):  # searches that succeed get better within 8
            outcome = "blocked" if expanded == 1 else "stuck"
            return Unfolded(outcome=outcome, states=nearest, expanded=expanded)
        parent, hinge = turns.parent[accepted], turns.hinge[accepted]
        trail.add(parent, hinge, beam[parent, hinge])
        beam = beam[parent]
        beam[np.arange(len(accepted)), hinge] += turns.change[accepted].astype(np.int8)
        keys = turns.key[accepted]
        if improves:
            best = int(turns.score[accepted].argmin())
            nearest = trail.to(beam[best], best)
    at = int(np.argmin(beam.any(axis=1)))
    return Unfolded(outcome="straight", states=trail.to(beam[at], at), expanded=expanded)


def _first_clear(
    turning: Turning,
    beam: Levels,
    turns: Turns,
    order: Ints,
    visited: set[int],
    *,
    room: float,
    count: int,
) -> Ints:
    """Return the first clear turns in an order, each to a new state; note these as visited.

    Turns are tested in blocks, so that few are tested where most are clear.
    """
    accepted: list[int] = []
    start, size = 0, 2 * count
    while start < len(order) and len(accepted) < count:
        block = order[start : start + size]
        block = block[[key not in visited for key in turns.key[block].tolist()]]
        clear = turning.are_clear(beam, turns, block, room=room)
        for k in block[clear].tolist():
            key = int(turns.key[k])
            if key not in visited and len(accepted) < count:
                visited.add(key)
                accepted.append(k)
        start += size
        size *= 2
    return np.array(accepted, np.int64)
