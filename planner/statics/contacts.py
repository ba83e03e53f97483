"""Contacts of a chain with the plane z = 0 and with itself.

Gaps are stated for modules of a full pitch, which touch on the lattice with a gap of 0. Smaller
ones leave a gap of (1 − size) between two faces there; it is allowed for, so that the size only
moves the points inwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Flags, Ints
from foldback.planner.chain.corners import lowest_corners
from foldback.planner.chain.module import Module
from foldback.planner.chain.polyhedron import Polyhedron
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
    less = (1.0 - module_size) * module.face_distance
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
    """Return the parts of a module's pieces with their faces and edges for kernels."""
    parts = [part for piece in module.pieces for part in piece.parts]
    loops = [loop for part in parts for _, loop in part.faces]
    most_corners = max(len(loop) for loop in loops)
    edges = [_edges(part) for part in parts]
    counts = [
        (len(part.corners), len(part.faces), len(ends), len(part.edge_directions))
        for part, ends in zip(parts, edges, strict=True)
    ]
    stops = np.cumsum([(0, 0, 0, 0), *counts], axis=0)
    vertices = np.concatenate([part.corners for part in parts])
    return FacetedHull(
        vertices=vertices * module_size,
        normals=np.array([normal for part in parts for normal, _ in part.faces]),
        loops=np.array([[*loop, *[-1] * (most_corners - len(loop))] for loop in loops]),
        edges=np.concatenate(edges),
        directions=np.concatenate([part.edge_directions for part in parts]),
        parts=np.stack([stops[:-1], stops[1:]], axis=2).reshape(-1, 8),
        pieces=module.hull.pieces,
        kinds=module.hull.kinds,
        radius=module.radius * module_size,
    )


def _edges(part: Polyhedron) -> Ints:
    """Return the (E, 2) corners of each edge of a part."""
    ends = {tuple(sorted(edge)) for _, loop in part.faces for edge in pairwise((*loop, loop[0]))}
    return np.array(sorted(ends), dtype=np.int64)


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
    return lowest - (1.0 - module_size) * module.face_distance
