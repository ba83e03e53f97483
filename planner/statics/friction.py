"""Friction with the floor, after Coulomb, for a direction of motion.

A corner that slips is pushed back against its way with μ times what the floor bears there: one ray,
so that all stays linear. A corner that does not slip is held by anything in the cone, of which an
eight-sided pyramid inside it is taken. Modules that touch rub against each other without friction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.statics.contacts import Contacts

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
SIDES: Final = 8
"""Edges of the pyramid that stands for the cone of a corner that does not slip."""
SLIPS_FROM: Final = 1e-3
"""Share of the farthest module's way from which on a corner slips."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Friction:
    """Friction with the floor.

    Attributes:
        coefficient: μ.
        positions: (n, 3) where the modules are a moment later; None where nothing moves.
        rotations: (n, 3, 3) how they are turned then.
    """

    coefficient: float
    positions: Array | None = None
    rotations: Array | None = None


def rays(
    found: Contacts, friction: Friction | None, positions: Array, rotations: Array
) -> tuple[Ints, Array]:
    """Directions in which contacts push: the contact of each, and the force for a unit of it.

    Args:
        found: C contacts.
        friction: With the floor; None for none.
        positions: (n, 3) centres.
        rotations: (n, 3, 3) orientations.

    Returns:
        (R,) contacts and (R, 3) forces on their first module.
    """
    which = np.arange(len(found))
    if friction is None or friction.coefficient == 0.0:
        return which, found.normals
    floor = np.flatnonzero(found.on_floor)
    ways = slips(found, friction, positions, rotations)
    lengths = np.linalg.norm(ways, axis=1)
    slipping = lengths > 0.0
    normals = found.normals.copy()
    moving = floor[slipping]
    normals[moving, :2] -= friction.coefficient * ways[slipping] / lengths[slipping, None]
    still = floor[~slipping]
    turns = 2.0 * np.pi * np.arange(SIDES) / SIDES
    pyramid = np.column_stack(
        [friction.coefficient * np.cos(turns), friction.coefficient * np.sin(turns), np.ones(SIDES)]
    )
    rest = np.ones(len(found), dtype=bool)
    rest[still] = False
    which = np.concatenate([which[rest], np.repeat(still, SIDES)])
    order = np.argsort(which, kind="stable")
    forces = np.concatenate([normals[rest], np.tile(pyramid, (len(still), 1))])
    return which[order], forces[order]


def slips(found: Contacts, friction: Friction, positions: Array, rotations: Array) -> Array:
    """(K, 2) way of each corner on the floor along it; exactly zero for those that don't slip."""
    floor = found.on_floor
    modules, points = found.first[floor], found.points[floor]
    if friction.positions is None or friction.rotations is None:
        return np.zeros((len(points), 2))
    turns = friction.rotations[modules] @ np.swapaxes(rotations[modules], 1, 2)
    arms = points - positions[modules]
    ways = friction.positions[modules] + (turns @ arms[:, :, None])[:, :, 0] - points
    farthest = np.linalg.norm(friction.positions - positions, axis=1).max(initial=0.0)
    along = ways[:, :2].copy()
    along[np.linalg.norm(along, axis=1) <= max(SLIPS_FROM * farthest, 1e-12)] = 0.0
    return along
