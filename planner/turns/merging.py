"""Merging: turns that are made at once, in as few steps as can be proved clear."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.arrays import Array
from planner.chain.chain import Chain
from planner.chain.kinematics import forward_kinematics
from planner.clearance.sweep import ALLOWANCE_CAP, Between
from planner.kernels import Levels
from planner.kernels.clearance import least_separation
from planner.kernels.pairs import near_pairs
from planner.turns.turning import QUARTER_RAD, Turning

PIECE_ORDER: Final = (4, 2, 6, 1, 3, 5, 7, 0)
"""Order in which the eighths of a step are checked: where turns get in each other's way, it is most
often in the middle, and the first piece that is not clear ends the check."""
SAMPLES: Final = (np.array([8, 4, 12, 2, 6, 10, 14, 1, 3, 5, 7, 9, 11, 13, 15, 0]) + 0.5) / 16
"""Places on the way of a step, 0 to 1, at which poses are looked at before a step is proved, in the
order in which they are looked at."""
SAMPLE_GAP: Final = 2e-3
"""Distance, pitches, beyond the room that modules keep at these places: between two places they may
come somewhat nearer."""
MAX_MISFITS: Final = 12
"""Maximum number of turns that are left for a later step before a step is made. With 12 the wrench
of 160 cubes folds in 10 steps."""

Turn = tuple[int, int]
"""A hinge, and the change of its level."""
Split = tuple[list[Turn], list[Turn]]
"""The turns of a step, and those that are left for later steps."""


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
        self._size = turning.size + room / (2.0 * chain.module.inner_radius)
        self._chain = chain
        self._between = Between(chain, self._size)

    def holds(self, before: Levels, after: Levels) -> bool:
        """Return True if the motion between two states with these (J,) levels is proved clear."""
        places = np.linspace(0.0, 1.0, len(PIECE_ORDER) + 1)
        poses = _poses(before, after, places)
        return all(
            self._between.clearance(poses[k], poses[k + 1], ALLOWANCE_CAP) > 0.0
            for k in PIECE_ORDER
        )

    def seems_to_hold(self, before: Levels, after: Levels) -> bool:
        """Return True if some poses of the motion between two states are clear: no proof."""
        module = self._chain.module
        joints = np.flatnonzero(before != after) // module.hinges_per_joint + module.rigid_links
        segments = np.searchsorted(joints, np.arange(len(self._chain)))
        reach = 2.0 * module.radius * self._size + SAMPLE_GAP
        poses = forward_kinematics(module, _poses(before, after, SAMPLES))
        for positions, rotations in zip(poses.positions, poses.rotations, strict=True):
            pairs = near_pairs(positions, reach, module.apart)
            # Modules between which no hinge turns stay as they were.
            pairs = pairs[segments[pairs[:, 0]] != segments[pairs[:, 1]]]
            nearest = least_separation(
                positions, rotations, pairs, module.hull, self._size, SAMPLE_GAP
            )
            if nearest[0] < SAMPLE_GAP:
                return False
        return True


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
            step, left = self._proved(state, self._growth(state, left, size))
            _make(state, step)
            steps.append(step)
            size = max(1, len(step) // 2)
        return steps

    def _proved(self, state: Levels, growth: list[Split]) -> Split:
        """Return a late stage in the growth of a step that is proved clear.

        As a rule the last one is; if not, stages are halved between one that is proved and one that
        is not.
        """
        low, high, middle = 0, len(growth), len(growth) - 1
        while high - low > 1:
            after = state.copy()
            _make(after, growth[middle][0])
            if self._proof.holds(state, after):
                low = middle
            else:
                high = middle
            middle = (low + high) // 2
        return growth[low]

    def _growth(self, state: Levels, left: list[Turn], size: int) -> list[Split]:
        """Return the stages in the growth of one step that seems clear, from one turn on.

        To look at some poses takes a tenth of the time of a proof.

        Args:
            state: (J,) levels at the start; the first turn is known to be clear.
            left: Turns to make, in an order that is clear one by one.
            size: Number of turns that are tried at once at first; doubled while they are clear.
        """
        step, waiting, coming = left[:1], list[Turn](), left[1:]
        passed: set[int] = set()  # hinges with a turn that waits: their later turns wait, too
        misfits = 0
        stages = [(step, coming)]
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
            after = state.copy()
            _make(after, step + tried)
            clear = self._leaves_clear(after, waiting + later, rest)
            if clear and self._proof.seems_to_hold(state, after):
                step = [*step, *tried]
                waiting = [*waiting, *later]
                coming = rest
                size *= 2
                stages.append((step, waiting + coming))
            elif len(tried) > 1:
                size = len(tried) // 2
                continue
            else:
                waiting = [*waiting, *later, *tried]
                coming = rest
                misfits += 1
            passed = {hinge for hinge, _ in waiting}
        return stages

    def _leaves_clear(self, after: Levels, waiting: list[Turn], rest: list[Turn]) -> bool:
        """Return True if the turns after a step stay clear, one by one, though some waited."""
        if not waiting:
            return True
        hinges, changes = np.array(waiting + rest, np.int64).T.copy()
        count = self._turning.clear_turns(after, hinges, changes, room=self._room)
        return count == len(hinges)


def _poses(before: Levels, after: Levels, places: Array) -> Array:
    """Return (P, J) angles at some places, 0 to 1, on the way from one state to another."""
    start, end = QUARTER_RAD * before.astype(float), QUARTER_RAD * after.astype(float)
    return start + places[:, None] * (end - start)


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
