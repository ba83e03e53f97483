"""Contacts: where a chain that stands on the plane z = 0 touches it, and where it touches itself.

Gaps are told of modules of a full pitch, which touch on the lattice with a gap of 0. Smaller ones
leave a gap of (1 − size) between two faces there; it is allowed for, so that the size only moves
the points inwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.module import Module
from planner.kernels.statics import FacetedHull, contact_points

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
FLOOR: Final = -1
"""Stands for the floor where a number of a module is expected."""
FLOOR_GAP: Final = 0.02
"""Corners of modules up to this high stand on the floor, in pitches."""
MODULE_GAP: Final = 0.03
"""Modules up to this far from each other touch, in pitches."""
SUNK: Final = 0.01
"""Pitches that a module of a motion may lie in the table: a simulated one gives."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Contacts:
    """C contact points of a configuration. Forces act along the normals and only push.

    Attributes:
        first: (C,) the module that is pushed along the normal.
        second: (C,) the module that is pushed against it; ``FLOOR`` where that is the floor.
        feature: (C,) which corner stands on the floor, or which of a pair's points it is.
        points: (C, 3) where, in pitches.
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
    def on_floor(self) -> NDArray[np.bool_]:
        """(C,) which of them are with the floor; they come before all others."""
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
    size: float = 1.0,
    floor_gap: float = FLOOR_GAP,
    module_gap: float = MODULE_GAP,
) -> Contacts:
    """The contact points of one configuration.

    Linked cubes don't count (``Module.apart``): they share a joint and lack what would touch.

    Args:
        module: The kind of module.
        positions: (n, 3) centres in pitches.
        rotations: (n, 3, 3) orientations.
        size: Module size as a fraction of the pitch.
        floor_gap: Corners of full-size modules up to this high stand on the floor.
        module_gap: Full-size modules up to this far from each other touch.
    """
    less = (1.0 - size) * module.inner_radius
    found = contact_points(
        # Copies: a read-only array would be another type, for which all is compiled anew.
        np.array(positions, dtype=np.float64),
        np.array(rotations, dtype=np.float64),
        solid_of(module, float(size)),
        module.apart,
        floor_gap + less,
        module_gap + 2.0 * less,
    )
    return Contacts(**found._asdict())


@lru_cache(maxsize=16)
def solid_of(module: Module, size: float) -> FacetedHull:
    """A module's hull with its faces and edges, as kernels take it."""
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
    most = max(len(loop) for loop in loops)
    return FacetedHull(
        vertices=np.ascontiguousarray(module.vertices * size),
        normals=np.array(normals),
        loops=np.array([loop + [-1] * (most - len(loop)) for loop in loops], dtype=np.int64),
        edges=np.array(sorted(edges), dtype=np.int64),
        directions=np.array(module.edge_directions),
        radius=module.radius * size,
    )


def _around(points: Array, normal: Array, corners: Ints) -> list[int]:
    """Corners of a face in their order, counterclockwise seen against its normal."""
    middle = points.mean(axis=0)
    ahead = points[0] - middle
    aside = np.cross(normal, ahead)
    angles = np.arctan2((points - middle) @ aside, (points - middle) @ ahead)
    return [int(corners[k]) for k in np.argsort(angles)]


def floor_clearances(
    module: Module, positions: Array, rotations: Array, *, size: float = 1.0
) -> Array:
    """(F,) how high the lowest corner is; a module that lies flat on the floor has 0.

    Args:
        module: The kind of module.
        positions: (F, n, 3) centres in pitches.
        rotations: (F, n, 3, 3) orientations.
        size: Module size as a fraction of the pitch.
    """
    lowest = lowest_corners(module, positions, rotations, size=size).min(axis=-1)
    return lowest - (1.0 - size) * module.inner_radius


def lowest_corners(
    module: Module, positions: Array, rotations: Array, *, size: float = 1.0
) -> Array:
    """(F, n) how high the lowest corner of each module is; see ``floor_clearances``."""
    return (rotations[..., 2, :] @ (module.vertices * size).T).min(axis=-1) + positions[..., 2]
