"""Merging: moves that are made at once, in as few steps as can be proved clear."""

from __future__ import annotations

from typing import Final

from foldback.planner.core.structures import Levels
from foldback.planner.turns.moves import Move, RoomProof, make

MAX_MISFITS: Final = 96
"""Maximum number of moves that are left for a later step before a step is made. With 96 the wrench
of 160 cubes folds in 10 steps, with 12 in 15, in 1.4 times the time."""
Split = tuple[list[Move], list[Move]]
"""The moves of a step, and those that are left for later steps."""


class Merger:
    """Merges moves of a chain into steps.

    Args:
        proof: Proofs for the chain.
        at_once: Maximum number of hinges in a step.
    """

    def __init__(self, proof: RoomProof, *, at_once: int) -> None:
        self._proof = proof
        self._at_once = at_once

    def steps(self, start: Levels, moves: list[Move]) -> list[Move]:
        """Return steps that make the same turns as some moves.

        A move that does not fit into a step waits for a later one, and later moves of other hinges
        may pass it if all moves that are left stay clear, one by one.

        Args:
            start: (J,) levels before the first move.
            moves: Moves that are clear one by one.
        """
        state, remaining, size = start.copy(), moves, 1
        steps: list[Move] = []
        while remaining:
            step, remaining = self._proved(state, self._growth(state, remaining, size))
            steps.append(tuple(turn for move in step for turn in move))
            make(state, step)
            size = max(1, len(step) // 2)
        return steps

    def _proved(self, state: Levels, growth: list[Split]) -> Split:
        """Return a late stage in the growth of a step that is proved clear.

        As a rule the last one is; if not, stages are halved between one that is proved and one that
        is not.
        """
        low, high, middle = 0, len(growth), len(growth) - 1
        while high - low > 1:
            if self._proof.at_once(state, _after(state, growth[middle][0])):
                low = middle
            else:
                high = middle
            middle = (low + high) // 2
        return growth[low]

    def _growth(self, state: Levels, remaining: list[Move], size: int) -> list[Split]:
        """Return the stages in the growth of one step that seems clear, from one move on.

        Args:
            state: (J,) levels at the start; the first move is known to be clear.
            remaining: Moves to make, in an order that is clear one by one.
            size: Number of moves that are tried at once at first; doubled while they are clear.
        """
        step, waiting, coming = remaining[:1], list[Move](), remaining[1:]
        stages = [(step, coming)]
        misfits = 0
        while coming and misfits < MAX_MISFITS:
            extension, later, following = self._next(step, waiting, coming, size)
            if not extension:
                break
            if self._seems_clear(state, step + extension, waiting + later, following):
                step = step + extension
                waiting = waiting + later
                coming = following
                size *= 2
                stages.append((step, waiting + coming))
            elif len(extension) > 1:
                size = len(extension) // 2
            else:
                waiting = waiting + later + extension
                coming = following
                misfits += 1
        return stages

    def _next(
        self, step: list[Move], waiting: list[Move], coming: list[Move], size: int
    ) -> tuple[list[Move], list[Move], list[Move]]:
        """Return the next moves that may join a step, those that they pass, and the rest."""
        used = {hinge for move in step + waiting for hinge, _ in move}
        room = self._at_once - sum(map(len, step))
        extension: list[Move] = []
        later: list[Move] = []
        for move in coming:
            if len(extension) == size or room <= 0:
                break
            if len(move) > room or any(hinge in used for hinge, _ in move):
                later.append(move)
            else:
                extension.append(move)
                room -= len(move)
            used.update(hinge for hinge, _ in move)
        return extension, later, coming[len(extension) + len(later) :]

    def _seems_clear(
        self, state: Levels, step: list[Move], waiting: list[Move], following: list[Move]
    ) -> bool:
        """Return True if a step seems clear, and the moves after it are, one by one."""
        after = _after(state, step)
        if waiting and not self._proof.one_by_one(after, waiting + following):
            return False
        return self._proof.seems_clear(state, after)


def _after(state: Levels, moves: list[Move]) -> Levels:
    """Return the levels of a state after some moves."""
    after = state.copy()
    make(after, moves)
    return after
