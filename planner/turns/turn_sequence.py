"""Turn sequence: the steps by which a straight chain folds, and the search for them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.rotations import QUARTER_RAD
from foldback.planner.core.structures import Levels
from foldback.planner.progress import Cancelled, never
from foldback.planner.turns.beam_search import Outcome
from foldback.planner.turns.cube_turns import cube_turning
from foldback.planner.turns.merging import Merger
from foldback.planner.turns.moves import Move, RoomProof, moves_between, states_after
from foldback.planner.turns.room_search import RoomSearch
from foldback.planner.turns.shortening import shortened
from foldback.planner.turns.step_turning import StepTurning
from foldback.planner.turns.tetrahedron_turns import tetrahedron_turning

LATTICE_TURNINGS: Final = {"cells": cube_turning, "rings": tetrahedron_turning}
"""Turns of modules that fill a lattice, by their filling; others turn by their joints' steps."""


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
    chain: Chain,
    *,
    module_size: float,
    at_once: int | None,
    seed: int,
    roomy: bool = False,
    max_work: int = 0,
    cancelled: Cancelled = never,
) -> TurnSequence | NoTurns:
    """Search for the turns that fold a chain, and merge them into steps.

    The search begins folded, where there is least room, and ends straight; reversed, it folds.

    Args:
        chain: The chain: cubes on the lattice, tetrahedra in the honeycomb, or modules whose joints
            turn in steps.
        module_size: Module size as a fraction of the pitch.
        at_once: Maximum number of hinges that turn in one step; None for no limit.
        seed: Seed of the search.
        roomy: True to search with the most room alone.
        max_work: Work after which the search by the joints' steps stops; 0 for no limit.
        cancelled: Polled before each turn.
    """
    if chain.module.filling not in LATTICE_TURNINGS:
        return _find_steps(
            chain, module_size=module_size, at_once=at_once, seed=seed, max_work=max_work
        )
    turning = LATTICE_TURNINGS[chain.module.filling](chain, module_size)
    search = RoomSearch(
        chain, turning, pairs=at_once != 1, roomy=roomy, seed=seed, cancelled=cancelled
    )
    unfolded = search.unfold()
    if unfolded.outcome != "straight":
        angles = QUARTER_RAD * unfolded.states.astype(float)
        angles[0] = chain.folded_rad  # which a file may give to a few digits
        return NoTurns(outcome=unfolded.outcome, expanded=search.expanded, last_rad=angles)
    proof = RoomProof(chain, turning, search.room)
    moves = shortened(turning.folded, moves_between(unfolded.states), proof)
    max_turns = len(chain.folded_rad) if at_once is None else at_once
    steps = _fewest_steps(turning.folded, moves, Merger(proof, at_once=max_turns))
    rests = QUARTER_RAD * states_after(np.zeros_like(turning.folded), steps).astype(float)
    if steps:
        rests[-1] = chain.folded_rad
    return TurnSequence(
        rest_angles_rad=rests,
        hinges=tuple(tuple(hinge for hinge, _ in step) for step in steps),
        turns=sum(map(len, steps)),
        room=search.room,
    )


def _find_steps(
    chain: Chain, *, module_size: float, at_once: int | None, seed: int, max_work: int
) -> TurnSequence | NoTurns:
    """Search for turns by the joints' steps, with the most room that there is."""
    turning = StepTurning(chain, module_size)
    way = turning.way(together=at_once != 1, seed=seed, max_work=max_work)
    if not way.reached:
        angles = turning.step_rad * way.states.astype(float)
        angles[0] = chain.folded_rad
        return NoTurns(outcome="stuck", expanded=way.expanded, last_rad=angles)
    room = turning.room(way.size)
    proof = RoomProof(chain, turning, room)
    moves = shortened(turning.folded, moves_between(way.states), proof)
    max_turns = len(chain.folded_rad) if at_once is None else at_once
    steps = _fewest_steps(turning.folded, moves, Merger(proof, at_once=max_turns))
    rests = turning.step_rad * states_after(np.zeros_like(turning.folded), steps).astype(float)
    if steps:
        rests[-1] = chain.folded_rad
    return TurnSequence(
        rest_angles_rad=rests,
        hinges=tuple(tuple(hinge for hinge, _ in step) for step in steps),
        turns=sum(map(len, steps)),
        room=room,
    )


def _fewest_steps(folded: Levels, moves: list[Move], merger: Merger) -> list[Move]:
    """Return the steps from straight to folded, merged from the end where that makes fewer.

    Args:
        folded: (J,) levels of the folded chain.
        moves: Moves from folded to straight.
        merger: Merges moves.
    """
    unfolding = _reversed(merger.steps(folded, moves))
    folding = merger.steps(np.zeros_like(folded), _reversed(moves))
    return min(folding, unfolding, key=len)


def _reversed(moves: list[Move]) -> list[Move]:
    return [tuple((hinge, -change) for hinge, change in move) for move in moves[::-1]]
