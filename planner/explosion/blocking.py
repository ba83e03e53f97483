"""Blocking: whether the modules of a chain that sticks block each other, and in which directions.

Each bent hinge is turned towards straight by itself, and the unit that a peeling lets go next is
moved along the lattice. That all of it is blocked does not prove that no motion of many hinges at
once leads on; it says what lies in the way of each.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.kinematics import Poses, forward_kinematics
from planner.explosion.block_evidence import BlockEvidence, Move, Turn
from planner.kernels.clearance import least_separation
from planner.kernels.pairs import near_pairs

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
BENT_RAD: Final = 1.0
"""Bend from which on a joint is told as stuck: most of a right angle."""
TURNS_RAD: Final = tuple(np.deg2rad([1.0, 2.0, 3.0, 4.0, 5.0]).tolist())
"""Turns that are tried of each hinge; one that can make the largest of them is free."""
MOVED: Final = 0.5
"""Pitches that a unit is moved: farther than anything that leaves the core is loose in it."""
LEAST_OVERLAP: Final = 1e-3
"""Pitches by which modules overlap at least where they block each other."""
MOST_TURNS: Final = 400
"""Bent hinges that are looked at, at most: of more than that nothing is said."""
DIRECTIONS: Final = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))


def blocked(
    chain: Chain,
    angles_rad: Array,
    *,
    size: float,
    first_hinge: int = 0,
    unit: tuple[int, int] | None = None,
) -> BlockEvidence | None:
    """The modules that block each other; None when a bent hinge is free to turn.

    Args:
        chain: The chain.
        angles_rad: (J,) where it sticks.
        size: Module size at which they are to be clear, as a fraction of the pitch.
        first_hinge: Hinges before it are those of a peeling's core, and not let go.
        unit: First and last module of the unit that a peeling lets go next, if there is one.
    """
    bent = np.flatnonzero(np.abs(angles_rad) > BENT_RAD)
    bent = bent[bent >= first_hinge]
    if len(bent) > MOST_TURNS:
        return None
    # What overlaps before a turn does not lie in its way.
    before = _overlapping(chain, angles_rad, size) if len(bent) else set[tuple[int, int]]()
    turns: list[Turn] = []
    for hinge in bent.tolist():
        turn = _turn(chain, angles_rad, hinge, size, before)
        if turn is None:
            return None
        turns.append(turn)
    moves = () if unit is None else _moves(chain, unit, size)
    if not turns and not moves:
        return None
    return BlockEvidence(
        module_size=size,
        bent_above_rad=BENT_RAD,
        first_hinge=first_hinge,
        turns=tuple(turns),
        unit=unit,
        moves=moves,
    )


def _turn(
    chain: Chain, angles: Array, hinge: int, size: float, before: set[tuple[int, int]]
) -> Turn | None:
    """What one hinge runs into on its way towards straight; None when it is free."""
    module = hinge // chain.module.hinges_per_joint + chain.module.rigid_links
    for turned in TURNS_RAD:
        now = angles.copy()
        now[hinge] -= np.sign(angles[hinge]) * turned
        poses = forward_kinematics(chain.module, now)
        pairs = near_pairs(poses.positions, 2.0 * chain.module.radius * size, chain.module.apart)
        across = (pairs.min(axis=1) <= module) & (pairs.max(axis=1) > module)
        kept = [pair for pair in pairs[across].tolist() if tuple(pair) not in before]
        depth, pair = _deepest(chain, poses, kept, size)
        if pair is not None:
            return Turn(
                hinge=hinge,
                module=module,
                turned_rad=float(now[hinge] - angles[hinge]),
                modules=pair,
                overlap=depth,
            )
    return None


def _overlapping(chain: Chain, angles: Array, size: float) -> set[tuple[int, int]]:
    """All pairs that overlap in a configuration."""
    poses = forward_kinematics(chain.module, angles)
    pairs = near_pairs(poses.positions, 2.0 * chain.module.radius * size, chain.module.apart)
    return {(i, j) for i, j in pairs.tolist() if _deepest(chain, poses, [[i, j]], size)[1]}


def _moves(chain: Chain, unit: tuple[int, int], size: float) -> tuple[Move, ...]:
    """What a unit runs into in each direction; nothing when it is free in one of them."""
    poses = forward_kinematics(chain.module, chain.folded_rad[: _hinges_to(chain, unit[1])])
    moves: list[Move] = []
    for direction in DIRECTIONS:
        positions = poses.positions.copy()
        positions[unit[0] :] += MOVED * np.array(direction)
        pairs = near_pairs(positions, 2.0 * chain.module.radius * size, chain.module.apart)
        across = pairs[(pairs.min(axis=1) < unit[0]) & (pairs.max(axis=1) >= unit[0])]
        there = Poses(positions=positions, rotations=poses.rotations)
        depth, pair = _deepest(chain, there, across.tolist(), size)
        if pair is None:
            return ()
        core, moved = sorted(pair)
        moves.append(Move(direction=direction, moved=MOVED, modules=(moved, core), overlap=depth))
    return tuple(moves)


def _hinges_to(chain: Chain, module: int) -> int:
    """Hinges of the joints before a module."""
    return (module - chain.module.rigid_links) * chain.module.hinges_per_joint


def _deepest(
    chain: Chain, poses: Poses, pairs: list[list[int]], size: float
) -> tuple[float, tuple[int, int] | None]:
    """The deepest overlap among pairs and the pair that has it; None when there is none."""
    separation, i, j = least_separation(
        poses.positions,
        poses.rotations,
        np.array(pairs, dtype=np.int64).reshape(-1, 2),
        chain.module.hull,
        size,
        -LEAST_OVERLAP,
    )
    return (0.0, None) if i < 0 else (-float(separation), (int(i), int(j)))
