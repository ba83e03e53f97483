"""Friction with the floor, after Coulomb, for a direction of motion.

A corner that slips is pushed back against its way with μ times what the floor bears there, so that
all stays linear. A corner that does not slip is held by anything in the cone, of which an
eight-sided pyramid inside it is taken. Contacts between modules have no friction.

If the base is clamped, the displacements of the corners are those of the motion. If it is free, the
planar drift of the whole chain is unknown: its twist is the one with the least friction work,
Σ μ N |v|, a convex function of three unknowns, for the forces N that the floor bears without
friction. As friction changes those a little, a corner may be pushed back within
``DIRECTION_SPREADS_RAD`` of the direction −v then.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.statics.contacts import Contacts

CONE_SIDES: Final = 8
"""Number of edges of the pyramid, inside the friction cone, that approximates the permitted contact
forces of a module's corner that sticks to the table."""
DIRECTION_SPREADS_RAD: Final = (0.2, 0.8)
"""Friction acts opposite to slipping, but the drift of a chain on a table is only estimated.
Angles, rad, to either side within which friction may point; the second is used if there is no
equilibrium with the first."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Friction:
    """Friction with the floor and the configuration that the motion approaches.

    Attributes:
        coefficient: Coefficient of friction μ.
        positions: (n, 3) centres a moment later, pitches; None without motion.
        rotations: (n, 3, 3) orientations a moment later; None without motion.
        fan: Half-angle about −v within which friction may point, rad.
        slips_from: Displacement from which a corner slips, as a share of the largest one.
    """

    coefficient: float
    positions: Array | None = None
    rotations: Array | None = None
    fan: float = 0.0
    slips_from: float = 1e-3


def rays(
    touching: Contacts, friction: Friction | None, positions: Array, rotations: Array
) -> tuple[Ints, Array]:
    """Return generators of the friction cones: contact and unit force of each.

    Args:
        touching: C contacts.
        friction: Friction with the floor; None for a smooth floor.
        positions: (n, 3) centres.
        rotations: (n, 3, 3) orientations.

    Returns:
        (R,) contacts, ordered, and (R, 3) forces on their first module.
    """
    everything = np.arange(len(touching))
    if friction is None or friction.coefficient == 0.0:
        return everything, touching.normals
    floor = np.flatnonzero(touching.on_floor)
    ways = slip_displacements(touching, friction, positions, rotations)
    slipping = np.linalg.norm(ways, axis=1) > 0.0
    moving, still = floor[slipping], floor[~slipping]
    opposite = np.arctan2(-ways[slipping, 1], -ways[slipping, 0])
    fan = (0.0,) if friction.fan == 0.0 else (-friction.fan, friction.fan)
    turns = 2.0 * np.pi * np.arange(CONE_SIDES) / CONE_SIDES
    contact_rows = np.concatenate(
        [np.setdiff1d(everything, floor), *(moving for _ in fan), np.repeat(still, CONE_SIDES)]
    )
    forces = np.concatenate(
        [
            touching.normals[~touching.on_floor],
            *(_leaning(opposite + angle, friction.coefficient) for angle in fan),
            np.tile(_leaning(turns, friction.coefficient), (len(still), 1)),
        ]
    )
    order = np.argsort(contact_rows, kind="stable")
    return contact_rows[order], forces[order]


def slip_displacements(
    touching: Contacts, friction: Friction, positions: Array, rotations: Array
) -> Array:
    """Return the (K, 2) displacement of each corner on the floor; exactly 0 for sticking ones."""
    ways = _ways(touching, friction, positions, rotations)
    farthest = _farthest(friction, positions)
    ways[np.linalg.norm(ways, axis=1) <= friction.slips_from * farthest] = 0.0
    return ways


def with_estimated_drift(
    touching: Contacts, friction: Friction, positions: Array, rotations: Array, pressures: Array
) -> Friction:
    """Return the friction after the rigid drift of the whole chain with the least work.

    Args:
        touching: C contacts, K of them with the floor.
        friction: Friction with the floor.
        positions: (n, 3) centres.
        rotations: (n, 3, 3) orientations.
        pressures: (K,) normal forces at the corners, in weights of a module.
    """
    if friction.positions is None or friction.rotations is None:
        return friction
    ways = _ways(touching, friction, positions, rotations)
    ends = touching.points[touching.on_floor][:, :2] + ways
    middle = positions[:, :2].mean(axis=0)
    # Way of each corner for a shift by one pitch along x, along y, and a turn by one radian.
    moves = np.zeros((len(ends), 2, 3))
    moves[:, 0, 0] = moves[:, 1, 1] = 1.0
    moves[:, 0, 2], moves[:, 1, 2] = middle[1] - ends[:, 1], ends[:, 0] - middle[0]
    # Friction is reduced in proportion below this displacement; Coulomb's is not.
    softening = 2e-3 * max(_farthest(friction, positions), 1e-9)
    twist = np.zeros(3)
    for _ in range(100):  # by least squares whose weights follow (Weiszfeld's method)
        now = ways + moves @ twist
        weights = pressures / np.sqrt((now**2).sum(axis=1) + softening**2)
        normal = np.einsum("k,kix,kiy->xy", weights, moves, moves)
        against = np.einsum("k,kix,ki->x", weights, moves, ways)
        before = twist
        twist = -np.linalg.lstsq(normal, against, rcond=1e-12)[0]
        if np.abs(twist - before).max() < 1e-3 * softening:
            break
    cosine, sine = np.cos(twist[2]), np.sin(twist[2])
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    pivot = np.array([*middle, 0.0])
    return replace(
        friction,
        positions=(friction.positions - pivot) @ turn.T + pivot + np.array([*twist[:2], 0.0]),
        rotations=turn @ friction.rotations,
        fan=DIRECTION_SPREADS_RAD[0],
        slips_from=0.02,
    )


def wider(friction: Friction) -> Friction:
    """Return the friction with the wider one of ``DIRECTION_SPREADS_RAD``."""
    return replace(friction, fan=DIRECTION_SPREADS_RAD[1])


def _ways(touching: Contacts, friction: Friction, positions: Array, rotations: Array) -> Array:
    """Return the (K, 2) displacement of each corner along the floor."""
    floor = touching.on_floor
    modules, points = touching.first[floor], touching.points[floor]
    if friction.positions is None or friction.rotations is None:
        return np.zeros((len(points), 2))
    turns = friction.rotations[modules] @ np.swapaxes(rotations[modules], 1, 2)
    arms = points - positions[modules]
    ends = friction.positions[modules] + (turns @ arms[:, :, None])[:, :, 0]
    return (ends - points)[:, :2]


def _farthest(friction: Friction, positions: Array) -> float:
    """Return the largest displacement of a module, pitches."""
    if friction.positions is None:
        return 0.0
    return float(np.linalg.norm(friction.positions - positions, axis=1).max(initial=0.0))


def _leaning(angles: Array, coefficient: float) -> Array:
    """Return (R, 3) forces with unit normal part that lean towards directions in the plane."""
    return np.column_stack(
        [coefficient * np.cos(angles), coefficient * np.sin(angles), np.ones(len(angles))]
    )
