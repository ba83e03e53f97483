"""Moves: single turns, or pairs of turns at once, and proofs that they are clear."""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.clearance.sweep import ALLOWANCE_CAP, Between
from foldback.planner.core import least_separation, near_pairs
from foldback.planner.core.structures import Levels

PIECE_ORDER: Final = (4, 2, 6, 1, 3, 5, 7, 0)
"""Order in which the eighths of a motion are checked: where turns get in each other's way, it is
most often in the middle, and the first piece that is not clear ends the check."""

SAMPLES: Final = (np.array([8, 4, 12, 2, 6, 10, 14, 1, 3, 5, 7, 9, 11, 13, 15, 0]) + 0.5) / 16
"""Places on the way of a motion, 0 to 1, at which poses are looked at before it is proved, in the
order in which they are looked at."""

Turn = tuple[int, int]
"""A hinge, and the change of its level."""
Move = tuple[Turn, ...]
"""Turns that are made at once: mostly one, or two where no single one is clear."""


class TestedTurns(Protocol):
    """Turns of single hinges that can be tested."""

    @property
    def size(self) -> float:
        """Module size as a fraction of the pitch."""
        ...

    @property
    def step_rad(self) -> Array | float:
        """Angle of a step of each hinge, or of all hinges."""
        ...

    def clear_turns(self, start: Levels, hinges: Ints, changes: Ints, *, room: float) -> int:
        """Return the number of turns before the first that is not clear."""
        ...


class RoomProof:
    """Proofs that modules keep a distance while hinges turn.

    Args:
        chain: The chain.
        turning: Its turns.
        room: Distance that modules must keep, pitches.
    """

    def __init__(self, chain: Chain, turning: TestedTurns, room: float) -> None:
        self._turning = turning
        self._room = room
        self._proved: dict[tuple[bytes, bytes], bool] = {}
        # Modules so much larger that they use up the room in front of a face keep apart only where
        # the modules keep about that room.
        self._size = turning.size + room / (2.0 * chain.module.inner_radius)
        self._chain = chain
        self._between = Between(chain, self._size)

    def at_once(self, before: Levels, after: Levels) -> bool:
        """Return True if the even motion between two states with (J,) levels is proved clear."""
        key = (before.tobytes(), after.tobytes())
        if key not in self._proved:
            poses = self._poses(before, after, np.linspace(0.0, 1.0, len(PIECE_ORDER) + 1))
            self._proved[key] = all(
                self._between.clearance(poses[k], poses[k + 1], ALLOWANCE_CAP) > 0.0
                for k in PIECE_ORDER
            )
        return self._proved[key]

    def seems_clear(self, before: Levels, after: Levels, *, sample_gap: float = 2e-3) -> bool:
        """Return True if some poses of the motion between two states are clear: no proof.

        That takes a tenth of the time of a proof.

        Args:
            before, after: (J,) levels.
            sample_gap: Distance that modules must keep beyond the room, pitches.
        """
        module = self._chain.module
        joints = module.module_before(np.flatnonzero(before != after))
        segments = np.searchsorted(joints, np.arange(len(self._chain)))
        reach = 2.0 * module.radius * self._size + sample_gap
        for places in (SAMPLES[:1], SAMPLES[1:]):  # the first one settles most motions
            poses = forward_kinematics(module, self._poses(before, after, places))
            for positions, rotations in zip(poses.positions, poses.rotations, strict=True):
                pairs = near_pairs(positions, reach, module.apart)
                # Modules between which no hinge turns stay as they were.
                pairs = pairs[segments[pairs[:, 0]] != segments[pairs[:, 1]]]
                nearest = least_separation(
                    positions, rotations, pairs, module.hull, self._size, sample_gap
                )
                if nearest[0] < sample_gap:
                    return False
        return True

    def _poses(self, before: Levels, after: Levels, places: Array) -> Array:
        """Return (P, J) angles at some places, 0 to 1, on the way from one state to another."""
        step = self._turning.step_rad
        start, end = step * before.astype(float), step * after.astype(float)
        return start + places[:, None] * (end - start)

    def one_by_one(self, start: Levels, moves: list[Move]) -> bool:
        """Return True if moves are clear, made one by one from a state with (J,) levels on."""
        state = start.copy()
        pairs: list[tuple[Levels, Levels]] = []
        first_move = 0
        while first_move < len(moves):
            end = first_move
            while end < len(moves) and len(moves[end]) == 1:
                end += 1
            if end > first_move:
                turns = np.array([move[0] for move in moves[first_move:end]], np.int64)
                hinges, changes = turns.T.copy()
                if self._turning.clear_turns(state, hinges, changes, room=self._room) < len(turns):
                    return False
                make(state, moves[first_move:end])
            if end < len(moves):
                before = state.copy()
                make(state, moves[end : end + 1])
                pairs.append((before, state.copy()))
            first_move = end + 1
        return all(self.at_once(*pair) for pair in pairs)


def moves_between(states: Levels) -> list[Move]:
    """Return the moves between (T + 1, J) levels; neighbours differ by what turns at once."""
    differences: NDArray[np.int8] = np.diff(states, axis=0)
    return [
        tuple((hinge, int(row[hinge])) for hinge in np.flatnonzero(row).tolist())
        for row in differences
    ]


def make(state: Levels, moves: list[Move]) -> None:
    """Change the levels of a state by some moves."""
    for move in moves:
        for hinge, change in move:
            state[hinge] += change


def states_after(start: Levels, moves: list[Move]) -> Levels:
    """Return (T + 1, J) levels: a state, and those after each of T moves."""
    states = np.repeat(start[None], len(moves) + 1, axis=0)
    for k, move in enumerate(moves):
        make(states[k + 1 :].T, [move])
    return states
