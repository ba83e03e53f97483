"""Blocking: a test of a stalled chain for modules that block each other, and in which directions.

Each bent hinge is turned towards straight by itself, and the unit that a peeling lets go next is
moved along the lattice. In a folded chain, each hinge makes a quarter turn by itself. That all of
it is blocked does not prove that no motion of many hinges at once leads on; it says what lies in
the way of each.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import Poses, forward_kinematics
from foldback.planner.chain.path import STEPS
from foldback.planner.chain.rotations import QUARTER_RAD
from foldback.planner.core import least_separation, near_pairs
from foldback.planner.explosion.failure_evidence import (
    BlockEvidence,
    Move,
    QuarterTurnEvidence,
    Turn,
)

STUCK_JOINT_BEND_RAD: Final = 1.0
"""Minimum angle of a hinge, rad, at which the report on a stalled unfolding counts its joint as
stuck; folded joints have a right angle."""
TRIAL_TURNS_RAD: Final = tuple(np.deg2rad([1.0, 2.0, 3.0, 4.0, 5.0]).tolist())
"""Angles, rad, by which each bent hinge of a stalled chain is turned towards straight, one after
the other, until modules overlap. A hinge that can make the largest turn is free."""
QUARTER_TRIALS: Final = tuple((k + 0.5) / 2**m for m in range(6) for k in range(2**m))
"""Fractions of a quarter turn at which overlaps are looked for: in the middle first, where modules
that turn meet most others, then in the middles of the halves, and so on, every 1.4° at last."""
TRIAL_MOVE_PITCH: Final = 0.5
"""Distance, pitches, by which the next modules to be released are moved along each lattice
direction, to test which folded modules block them."""


def blocked(
    chain: Chain,
    angles_rad: Array,
    *,
    module_size: float,
    first_hinge: int = 0,
    unit: tuple[int, int] | None = None,
) -> BlockEvidence | None:
    """Find the modules that block each other; None if a bent hinge is free to turn.

    Args:
        chain: The chain.
        angles_rad: (J,) hinge angles where the chain stalled, rad.
        module_size: Module size at which they are to be clear, as a fraction of the pitch.
        first_hinge: First hinge that is released; those before it belong to a peeling's core.
        unit: First and last module of the unit that a peeling releases next, if there is one.
    """
    bent = np.flatnonzero(np.abs(angles_rad) > STUCK_JOINT_BEND_RAD)
    bent = bent[bent >= first_hinge]
    if len(bent) > 400:
        return None
    # What overlaps before a turn does not lie in its way.
    before = _overlapping(chain, angles_rad, module_size) if len(bent) else set[tuple[int, int]]()
    turns: list[Turn] = []
    for hinge in bent.tolist():
        changes = -np.sign(angles_rad[hinge]) * np.array(TRIAL_TURNS_RAD)
        turn = _turn(chain, angles_rad, hinge, changes, module_size, before)
        if turn is None:
            return None
        turns.append(turn)
    moves = () if unit is None else _moves(chain, unit, module_size)
    if not turns and not moves:
        return None
    return BlockEvidence(
        module_size=module_size,
        bent_above_rad=STUCK_JOINT_BEND_RAD,
        first_hinge=first_hinge,
        turns=tuple(turns),
        unit=unit,
        moves=moves,
    )


def no_quarter_turn(chain: Chain, *, module_size: float) -> QuarterTurnEvidence | None:
    """Find the modules that block each quarter turn of a folded chain; None if one may be free.

    Args:
        chain: The chain.
        module_size: Module size at which they overlap, as a fraction of the pitch.
    """
    angles, turns = chain.folded_rad, list[Turn]()
    before = _overlapping(chain, angles, module_size)
    low, high = chain.stops_rad().T
    for hinge in range(len(angles)):
        for change in (-QUARTER_RAD, QUARTER_RAD):
            if not low[hinge] <= angles[hinge] + change <= high[hinge]:
                continue
            turn = _turn(
                chain, angles, hinge, change * np.array(QUARTER_TRIALS), module_size, before
            )
            if turn is None:
                return None
            turns.append(turn)
    return QuarterTurnEvidence(module_size=module_size, turns=tuple(turns)) if turns else None


def _turn(
    chain: Chain,
    angles: Array,
    hinge: int,
    changes: Array,
    module_size: float,
    before: set[tuple[int, int]],
) -> Turn | None:
    """Find the first overlap when one hinge is turned by some angles; None if it is free."""
    module = chain.module_before(hinge)
    for change in changes.tolist():
        now = angles.copy()
        now[hinge] += change
        poses = forward_kinematics(chain.module, now)
        pairs = near_pairs(
            poses.positions, 2.0 * chain.module.radius * module_size, chain.module.apart
        )
        across = (pairs.min(axis=1) <= module) & (pairs.max(axis=1) > module)
        new = [pair for pair in pairs[across].tolist() if tuple(pair) not in before]
        depth, pair = _deepest(chain, poses, new, module_size)
        if pair is not None:
            return Turn(
                hinge=hinge,
                module=module,
                turned_rad=float(now[hinge] - angles[hinge]),
                modules=pair,
                overlap=depth,
            )
    return None


def _overlapping(chain: Chain, angles: Array, module_size: float) -> set[tuple[int, int]]:
    """Return all pairs that overlap in a configuration."""
    poses = forward_kinematics(chain.module, angles)
    pairs = near_pairs(poses.positions, 2.0 * chain.module.radius * module_size, chain.module.apart)
    return {(i, j) for i, j in pairs.tolist() if _deepest(chain, poses, [[i, j]], module_size)[1]}


def _moves(chain: Chain, unit: tuple[int, int], module_size: float) -> tuple[Move, ...]:
    """Find the overlap of a unit in each direction; empty if it is free in one of them."""
    poses = forward_kinematics(chain.module, chain.folded_rad[: _hinges_to(chain, unit[1])])
    moves: list[Move] = []
    for direction in STEPS:
        positions = poses.positions.copy()
        positions[unit[0] :] += TRIAL_MOVE_PITCH * np.array(direction)
        pairs = near_pairs(positions, 2.0 * chain.module.radius * module_size, chain.module.apart)
        across = pairs[(pairs.min(axis=1) < unit[0]) & (pairs.max(axis=1) >= unit[0])]
        moved_poses = Poses(positions=positions, rotations=poses.rotations)
        depth, pair = _deepest(chain, moved_poses, across.tolist(), module_size)
        if pair is None:
            return ()
        core, moved = sorted(pair)
        moves.append(
            Move(direction=direction, moved=TRIAL_MOVE_PITCH, modules=(moved, core), overlap=depth)
        )
    return tuple(moves)


def _hinges_to(chain: Chain, module: int) -> int:
    """Return the number of hinges of the joints before a module."""
    return chain.module.joint_after(module) * chain.module.hinges_per_joint


def _deepest(
    chain: Chain, poses: Poses, pairs: list[list[int]], module_size: float
) -> tuple[float, tuple[int, int] | None]:
    """Return the deepest overlap among pairs, in pitches, and its pair; None if there is none."""
    separation, i, j = least_separation(
        poses.positions,
        poses.rotations,
        np.array(pairs, dtype=np.int64).reshape(-1, 2),
        chain.module.hull,
        module_size,
        -1e-3,  # pitches
    )
    return (0.0, None) if i < 0 else (-float(separation), (int(i), int(j)))
