"""Turn sequence: the steps by which a straight chain folds, and the search for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from planner.arrays import Array
from planner.chain.chain import Chain
from planner.progress import Cancelled, never
from planner.turns.beam_search import Outcome, Unfolded, unfold
from planner.turns.cube_turns import CubeTurning
from planner.turns.merging import Merger, RoomProof
from planner.turns.tetrahedron_turns import TetrahedronTurning
from planner.turns.turning import QUARTER_RAD, Turning

ROOM_SHARES: Final = (0.45, 0.35, 0.09, 0.01)
"""Distances that modules must keep while they turn, as fractions of the gap between two cells; the
first with which a sequence is found is taken. At a module size of 0.95 the largest is 0.0225 pitch,
of which the certificate proves 0.02."""
PAIR_WIDTH: Final = 4
"""Width of the beam after two hinges have turned at once."""
LAST_WIDTH: Final = 16
"""Width of the beam if all else has failed, with the least room."""

MAX_PAIRS: Final = 6
"""Maximum number of times that two hinges turn at once because no single one leads on."""
MAX_TRIED_PAIRS: Final = 4
"""Maximum number of such pairs from which a search goes on, to take the one that gets farthest."""
MAX_PAIR_PROOFS: Final = 4000
"""Maximum number of pairs of hinges whose motion is checked in one search for turns."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TurnSequence:
    """Steps from straight to folded; in each, some hinges turn evenly from one rest to the next.

    Attributes:
        rest_angles_rad: (S + 1, J) angles at rest: straight, after each step, and folded.
        hinges: Hinges that turn in each of the S steps.
        turns: Number of turns of single hinges.
        room: Distance that modules keep during each turn, pitches.
    """

    rest_angles_rad: Array
    hinges: tuple[tuple[int, ...], ...]
    turns: int
    room: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoTurns:
    """A search that found no sequence.

    Attributes:
        outcome: ``blocked`` if no hinge can turn in the folded state, else ``stuck`` or
            ``cancelled``.
        expanded: Number of states whose turns were tried.
        last_rad: (T + 1, J) angles from folded to the last state that was reached.
    """

    outcome: Outcome
    expanded: int
    last_rad: Array


def find_turns(
    chain: Chain, *, size: float, at_once: int | None, seed: int, cancelled: Cancelled = never
) -> TurnSequence | NoTurns:
    """Search for the turns that fold a chain, and merge them into steps.

    The search begins folded, where there is least room, and ends straight; reversed, it folds.

    Args:
        chain: The chain: cubes on the lattice, or tetrahedra in the honeycomb.
        size: Module size as a fraction of the pitch.
        at_once: Maximum number of hinges that turn in one step; None for no limit.
        seed: Seed of the search.
        cancelled: Polled before each turn.
    """
    kind = CubeTurning if chain.module.fills_cell else TetrahedronTurning
    turning: Turning = kind(chain, size)
    search, room, expanded = _searched(turning, turning.width, ROOM_SHARES, seed, cancelled)
    if search.outcome in ("blocked", "stuck") and at_once != 1:
        search = _beyond(turning, RoomProof(chain, turning, room), search, room, seed)
    if search.outcome == "stuck":
        search, room, more = _searched(turning, LAST_WIDTH, ROOM_SHARES[-1:], seed, cancelled)
        expanded += more
    if search.outcome != "straight":
        angles = QUARTER_RAD * search.states.astype(float)
        return NoTurns(outcome=search.outcome, expanded=expanded, last_rad=angles)
    most = len(chain.folded_rad) if at_once is None else at_once
    merger = Merger(chain, turning, room=room, at_once=most)
    folding, unfolding = merger.steps(search.states[::-1]), merger.steps(search.states)
    steps = folding
    if len(unfolding) < len(folding):
        steps = [[(hinge, -change) for hinge, change in step] for step in unfolding[::-1]]
    changes = np.zeros((len(steps) + 1, len(chain.folded_rad)))
    for k, step in enumerate(steps):
        for hinge, change in step:
            changes[k + 1, hinge] = change
    return TurnSequence(
        rest_angles_rad=np.cumsum(changes, axis=0) * QUARTER_RAD,
        hinges=tuple(tuple(hinge for hinge, _ in step) for step in steps),
        turns=sum(map(len, steps)),
        room=room,
    )


def _searched(
    turning: Turning, width: int, shares: Sequence[float], seed: int, cancelled: Cancelled
) -> tuple[Unfolded, float, int]:
    """Return the first search that succeeds, or the best one; its room; states tried in all."""
    expanded, room = 0, 0.0
    best: Unfolded | None = None
    for share in shares:
        room = share * turning.cell_gap
        search = unfold(
            turning, turning.folded, room=room, width=width, seed=seed, cancelled=cancelled
        )
        expanded += search.expanded
        if search.outcome in ("straight", "cancelled"):
            return search, room, expanded
        if best is None or _bent(search) <= _bent(best):
            best = search
    assert best is not None
    return best, room, expanded


def _beyond(
    turning: Turning, proof: RoomProof, search: Unfolded, room: float, seed: int
) -> Unfolded:
    """Return a search that goes on where one has ended, by turning two hinges at once there."""
    proofs = 0
    for _ in range(MAX_PAIRS):
        state, further = search.states[-1], search
        tried = 0
        for pair in turning.pairs(state):
            proofs += 1
            if proofs > MAX_PAIR_PROOFS or tried >= MAX_TRIED_PAIRS:
                break
            if not proof.holds(state, pair):
                continue
            tried += 1
            after = unfold(turning, pair, room=room, width=PAIR_WIDTH, seed=seed)
            states = np.concatenate([search.states, after.states])
            outcome = "straight" if after.outcome == "straight" else "stuck"
            expanded = further.expanded + after.expanded
            longer = Unfolded(outcome=outcome, states=states, expanded=expanded)
            if _bent(longer) < _bent(further):
                further = longer
            if outcome == "straight":
                return further
        if further is search:
            return search
        search = further
    return search


def _bent(search: Unfolded) -> int:
    """Return the number of bent hinges where a search has ended."""
    return int(np.count_nonzero(search.states[-1]))
