"""Merging: turns that are made at once, in as few steps as can be proved clear."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.arrays import Array
from planner.chain.chain import Chain
from planner.clearance.sweep import ALLOWANCE_CAP, Between
from planner.kernels import Levels
from planner.turns.turning import QUARTER_RAD, Turning

PIECE_ORDER: Final = (4, 2, 6, 1, 3, 5, 7, 0)
"""Order in which the eighths of a step are checked: where turns get in each other's way, it is most
often in the middle, and the first piece that is not clear ends the check."""
MAX_MISFITS: Final = 12
"""Maximum number of turns that are left for a later step before a step is made. With 12 the wrench
of 160 cubes folds in 10 steps."""

Turn = tuple[int, int]
"""A hinge, and the change of its level."""


class RoomProof:
    """Proof that modules keep a distance while all hinges turn evenly from one pose to another.

    Args:
        chain: The chain.
        turning: Its turns.
        room: Distance that modules must keep, pitches.
    """

    def __init__(self, chain: Chain, turning: Turning, room: float) -> None:
        # Modules so much larger that they use up the room in front of a face keep apart only where
        # the modules keep about that room.
        self._between = Between(chain, turning.size + room / (2.0 * chain.module.inner_radius))

    def holds(self, before: Levels, after: Levels) -> bool:
        """Return True if the motion between two states with these (J,) levels is proved clear."""
        start, end = QUARTER_RAD * before.astype(float), QUARTER_RAD * after.astype(float)
        places = np.linspace(0.0, 1.0, len(PIECE_ORDER) + 1)[:, None]
        poses: Array = start + places * (end - start)
        return all(
            self._between.clearance(poses[k], poses[k + 1], ALLOWANCE_CAP) > 0.0
            for k in PIECE_ORDER
        )


class Merger:
    """Merges turns of a chain into steps.

    Args:
        chain: The chain.
        turning: Its turns.
        room: Distance that modules must keep, pitches.
        at_once: Maximum number of hinges in a step.
    """

    def __init__(self, chain: Chain, turning: Turning, *, room: float, at_once: int) -> None:
        self._turning = turning
        self._room = room
        self._at_once = at_once
        self._proof = RoomProof(chain, turning, room)

    def steps(self, states: Levels) -> list[list[Turn]]:
        """Return the turns of each step, from the first state to the last.

        A turn that does not fit into a step waits for a later one, and later turns of other hinges
        may pass it if all turns that are left stay clear, one by one.

        Args:
            states: (T + 1, J) levels; neighbours differ in one hinge by 1, or in two that must turn
                at once: these are a step of their own.
        """
        pairs = np.flatnonzero((np.diff(states, axis=0) != 0).sum(axis=1) > 1).tolist()
        steps: list[list[Turn]] = []
        for begin, end in zip([0, *(k + 1 for k in pairs)], [*pairs, len(states) - 1], strict=True):
            steps += self._steps_of_single_turns(states[begin : end + 1])
            if end < len(states) - 1:
                steps.append(_turns(states[end : end + 2]))
        return steps

    def _steps_of_single_turns(self, states: Levels) -> list[list[Turn]]:
        left = _turns(states)
        state = states[0].copy()
        steps: list[list[Turn]] = []
        size = 1
        while left:
            step, left = self._step(state, left, size)
            _make(state, step)
            steps.append(step)
            size = max(1, len(step) // 2)
        return steps

    def _step(self, state: Levels, left: list[Turn], size: int) -> tuple[list[Turn], list[Turn]]:
        """Return the turns of one step and those that are left.

        Args:
            state: (J,) levels at the start; the first turn is known to be clear.
            left: Turns to make, in an order that is clear one by one.
            size: Number of turns that are tried at once at first; doubled while they are clear.
        """
        step, waiting, coming = left[:1], list[Turn](), left[1:]
        passed: set[int] = set()  # hinges with a turn that waits: their later turns wait, too
        misfits = 0
        while coming and len(step) < self._at_once and misfits < MAX_MISFITS:
            used = passed | {hinge for hinge, _ in step}
            tried: list[Turn] = []
            later: list[Turn] = []
            limit = min(size, self._at_once - len(step))
            while coming[len(tried) + len(later) :] and len(tried) < limit:
                turn = coming[len(tried) + len(later)]
                (later if turn[0] in used else tried).append(turn)
                used.add(turn[0])
            rest = coming[len(tried) + len(later) :]
            if not tried:
                break
            if self._clear(state, step + tried, waiting + later, rest):
                step += tried
                waiting += later
                coming = rest
                size *= 2
            elif len(tried) > 1:
                size = len(tried) // 2
                continue
            else:
                waiting += later + tried
                coming = rest
                misfits += 1
            passed = {hinge for hinge, _ in waiting}
        return step, waiting + coming

    def _clear(
        self, state: Levels, step: list[Turn], waiting: list[Turn], rest: list[Turn]
    ) -> bool:
        """Return True if a step is proved clear, and the turns after it are, one by one."""
        after = state.copy()
        _make(after, step)
        if waiting:
            hinges, changes = np.array(waiting + rest, np.int64).T.copy()
            count = self._turning.clear_turns(after, hinges, changes, room=self._room)
            if count < len(hinges):
                return False
        return self._proof.holds(state, after)


def _turns(states: Levels) -> list[Turn]:
    """Return the turns between neighbouring states."""
    differences: NDArray[np.int8] = np.diff(states, axis=0)
    rows, hinges = np.nonzero(differences)
    changes = differences[rows, hinges]
    return list(zip(hinges.tolist(), changes.tolist(), strict=True))


def _make(state: Levels, turns: list[Turn]) -> None:
    """Change the levels of a state by some turns."""
    for hinge, change in turns:
        state[hinge] += change
