"""Contacts of a chain with the plane z = 0 and with itself.

Gaps are stated for modules of a full pitch, which touch on the lattice with a gap of 0. Smaller
ones leave a gap of (1 − size) between two faces there; it is allowed for, so that the size only
moves the points inwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Flags, Ints
from foldback.planner.chain.module import Module
from foldback.planner.core import contact_points
from foldback.planner.core.structures import FacetedHull

FLOOR: Final = -1
"""Number that denotes the floor in a list of contacts, where other numbers are those of modules."""
FLOOR_GAP: Final = 0.02
"""Maximum height, in pitches, of a module's corner that counts as touching the floor."""
MODULE_GAP: Final = 0.03
"""Maximum distance, in pitches, of two modules that count as touching."""
MAX_TABLE_PENETRATION_PITCH: Final = 0.01
"""Maximum depth of a module below the table's surface, in pitches, at which it counts as standing
on the table, as contacts in a simulation are compliant."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Contacts:
    """C contact points of a configuration. Forces act along the normals and only push.

    Attributes:
        first: (C,) module that is pushed along the normal.
        second: (C,) module that is pushed against it; ``FLOOR`` for the floor.
        feature: (C,) index of the corner on the floor, or of the point of a pair.
        points: (C, 3) contact points, pitches.
        normals: (C, 3) unit normals.
        gaps: (C,) distance of the two surfaces at this size; negative where they overlap.
    """

    first: Ints
    second: Ints
    feature: Ints
    points: Array
    normals: Array
    gaps: Array

    def __len__(self) -> int:
        return len(self.first)

    @property
    def on_floor(self) -> Flags:
        """(C,) flags of contacts with the floor, which come before all others."""
        return self.second == FLOOR

    @property
    def standing(self) -> Ints:
        """Modules that stand on the floor, in order."""
        return np.unique(self.first[self.on_floor])


def contacts(
    module: Module,
    positions: Array,
    rotations: Array,
    *,
    module_size: float = 1.0,
    floor_gap: float = FLOOR_GAP,
    module_gap: float = MODULE_GAP,
) -> Contacts:
    """Find the contact points of one configuration.

    Linked cubes are skipped (``Module.apart``): they share a joint and lack the parts that would
    touch.

    Args:
        module: The kind of module.
        positions: (n, 3) centres in pitches.
        rotations: (n, 3, 3) orientations.
        module_size: Module size as a fraction of the pitch.
        floor_gap: Height up to which corners of full-size modules touch the floor, pitches.
        module_gap: Distance up to which full-size modules touch, pitches.
    """
    less = (1.0 - module_size) * module.inner_radius
    points = contact_points(
        np.ascontiguousarray(positions, dtype=np.float64),
        np.ascontiguousarray(rotations, dtype=np.float64),
        solid_of(module, float(module_size)),
        module.apart,
        floor_gap + less,
        module_gap + 2.0 * less,
    )
    return Contacts(**points._asdict())


@lru_cache(maxsize=16)
def solid_of(module: Module, module_size: float) -> FacetedHull:
    """Return a module's hull with its faces and edges for kernels."""
    reach = module.vertices @ module.face_normals.T
    normals: list[Array] = []
    loops: list[list[int]] = []
    for k, normal in enumerate(module.face_normals):
        for sign in (1.0, -1.0):
            height = sign * reach[:, k]
            corners = np.flatnonzero(height > height.max() - 1e-9)
            if len(corners) > 2:
                normals.append(sign * normal)
                loops.append(_around(module.vertices[corners], sign * normal, corners))
    edges = {
        (min(p, q), max(p, q))
        for loop in loops
        for p, q in zip(loop, loop[1:] + loop[:1], strict=True)
    }
    max_corners = max(len(loop) for loop in loops)
    counts = len(module.vertices), len(loops), len(edges), len(module.edge_directions)
    return FacetedHull(
        vertices=np.ascontiguousarray(module.vertices * module_size),
        normals=np.array(normals),
        loops=np.array([loop + [-1] * (max_corners - len(loop)) for loop in loops], dtype=np.int64),
        edges=np.array(sorted(edges), dtype=np.int64),
        directions=np.array(module.edge_directions),
        parts=np.array([[end for count in counts for end in (0, count)]], dtype=np.int64),
        pieces=np.array([[0, 1]], dtype=np.int64),
        kinds=np.zeros(1, dtype=np.int64),
        radius=module.radius * module_size,
    )


def _around(points: Array, normal: Array, corners: Ints) -> list[int]:
    """Return the corners of a face counterclockwise, seen against its normal."""
    middle = points.mean(axis=0)
    ahead = points[0] - middle
    sideways = np.cross(normal, ahead)
    angles = np.arctan2((points - middle) @ sideways, (points - middle) @ ahead)
    return [int(corners[k]) for k in np.argsort(angles)]


def floor_clearances(
    module: Module, positions: Array, rotations: Array, *, module_size: float = 1.0
) -> Array:
    """Return the (F,) height of the lowest corner, pitches; 0 for a module flat on the floor.

    Args:
        module: The kind of module.
        positions: (F, n, 3) centres in pitches.
        rotations: (F, n, 3, 3) orientations.
        module_size: Module size as a fraction of the pitch.
    """
    lowest = lowest_corners(module, positions, rotations, module_size=module_size).min(axis=-1)
    return lowest - (1.0 - module_size) * module.inner_radius


def lowest_corners(
    module: Module, positions: Array, rotations: Array, *, module_size: float = 1.0
) -> Array:
    """Return the (F, n) height of the lowest corner of each module, pitches."""
    return (rotations[..., 2, :] @ (module.vertices * module_size).T).min(axis=-1) + positions[
        ..., 2
    ]
