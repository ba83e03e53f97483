"""Shortening: a sequence of moves without detours that nothing needs."""

from __future__ import annotations

from foldback.planner.core.structures import Levels
from foldback.planner.turns.moves import Move, RoomProof


def shortened(start: Levels, moves: list[Move], proof: RoomProof) -> list[Move]:
    """Return moves without turns of a hinge that are undone later, where all stays clear.

    Args:
        start: (J,) levels before the first move.
        moves: Moves that are clear one by one.
        proof: Proofs for the chain.
    """
    k = 0
    while k < len(moves):
        undone = _undone(moves, k)
        if undone is not None:
            shorter = moves[:k] + moves[k + 1 : undone] + moves[undone + 1 :]
            if proof.one_by_one(start, shorter):
                moves = shorter
                continue
        k += 1
    return moves


def _undone(moves: list[Move], k: int) -> int | None:
    """Return the number of the move that only undoes one of a single turn; None without one."""
    hinge, change = moves[k][0]
    for j in range(k + 1, len(moves)):
        if any(turning == hinge for turning, _ in moves[j]):
            return j if len(moves[k]) == 1 and moves[j] == ((hinge, -change),) else None
    return None
