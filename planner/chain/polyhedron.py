"""Convex polyhedra: faces and edges of the hull of some corners, and exact moments of volume."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import combinations, pairwise
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Ints

PLANE_TOLERANCE: Final = 1e-9
"""Distance from the plane of a face up to which corners belong to it, as a fraction of the
polyhedron's largest extent."""


def frozen(values: object) -> Array:
    """Return numbers as a read-only array in double precision."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class Polyhedron:
    """A convex polyhedron.

    Attributes:
        corners: (V, 3) corners.
        loops: Corners of each face, counterclockwise as seen from outside.
        face_normals: (A, 3) unit normals of the faces, one of each parallel pair.
        edge_directions: (E, 3) unit directions of the edges, one of each parallel set.
    """

    corners: Array
    loops: tuple[tuple[int, ...], ...]
    face_normals: Array
    edge_directions: Array

    @classmethod
    def of_corners(cls, corners: Array) -> Polyhedron:
        """Return the hull of (V, 3) corners, none of which may lie within it or on a face.

        Raises:
            ValueError: The corners lie in one plane, or one of them is no corner of the hull; the
                second argument is its index, or −1.
        """
        loops = _loops(np.asarray(corners, dtype=np.float64))
        used = {corner for loop in loops for corner in loop}
        if len(loops) < 4:
            raise ValueError("the corners lie in one plane", -1)
        if inside := set(range(len(corners))) - used:
            raise ValueError("the corner lies within the hull of the others", min(inside))
        normals = [_outward(corners, loop) for loop in loops]
        edges = [
            corners[b] - corners[a]
            for loop in loops
            for a, b in pairwise((*loop, loop[0]))
            if a < b
        ]
        return cls(frozen(corners), loops, _face_normals(normals), _edge_directions(edges))

    @cached_property
    def faces(self) -> tuple[tuple[Array, tuple[int, ...]], ...]:
        """Outward unit normal of each face and its corners, in the order of ``face_normals``."""
        faces = {frozenset(loop): loop for loop in self.loops}
        extent = float(np.ptp(self.corners, axis=0).max())
        return tuple(
            (normal, faces[corners])
            for line in self.face_normals
            for normal in (line, -line)
            if (corners := self._farthest(normal, PLANE_TOLERANCE * extent)) in faces
        )

    @cached_property
    def box(self) -> tuple[Array, Array] | None:
        """Centre and half sides of a box along the axes of the frame; None if it is no such box."""
        low, high = self.corners.min(axis=0), self.corners.max(axis=0)
        tolerance = PLANE_TOLERANCE * float((high - low).max())
        at_ends = np.minimum(self.corners - low, high - self.corners) <= tolerance
        if len(self.corners) != 8 or not at_ends.all():
            return None
        return 0.5 * (low + high), 0.5 * (high - low)

    def _farthest(self, normal: Array, tolerance: float) -> frozenset[int]:
        """Return the corners that are farthest along a direction."""
        heights = self.corners @ normal
        return frozenset(np.flatnonzero(heights > heights.max() - tolerance).tolist())

    def placed(self, position: Array, rotation: Array, *, size: float = 1.0) -> Polyhedron:
        """Return the polyhedron at a size and in the pose of a module, in the world's frame."""
        return Polyhedron(
            frozen(size * self.corners @ rotation.T + position),
            self.loops,
            frozen(self.face_normals @ rotation.T),
            frozen(self.edge_directions @ rotation.T),
        )

    def moved(self, origin: Array, axes: Array) -> Polyhedron:
        """Return the polyhedron in a frame at ``origin`` with the (3, 3) ``axes`` as columns."""
        return Polyhedron(
            frozen((self.corners - origin) @ axes),
            self.loops,
            frozen(self.face_normals @ axes),
            frozen(self.edge_directions @ axes),
        )


def _loops(corners: Array) -> tuple[tuple[int, ...], ...]:
    """Return the corners around each face of the hull."""
    extent = float(np.ptp(corners, axis=0).max())
    tolerance = PLANE_TOLERANCE * extent
    triples = np.array(list(combinations(range(len(corners)), 3)))
    a, b, c = (corners[triples[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    flat = lengths <= tolerance * extent
    normals = normals[~flat] / lengths[~flat, None]
    heights = (corners @ normals.T).T - np.einsum("ij,ij->i", normals, a[~flat])[:, None]
    loops: dict[frozenset[int], tuple[int, ...]] = {}
    for normal, row in zip(normals, heights, strict=True):
        sides = ((row > tolerance).any(), (row < -tolerance).any())
        if all(sides):
            continue
        members = np.flatnonzero(np.abs(row) <= tolerance)
        if (face := frozenset(members.tolist())) not in loops:
            loops[face] = _around(corners, members, normal if not sides[0] else -normal)
    return tuple(loops.values())


def _around(corners: Array, members: Ints, normal: Array) -> tuple[int, ...]:
    """Return the corners of one face counterclockwise, without those that lie on its edges."""
    middle = corners[members].mean(axis=0)
    first = corners[members[0]] - middle
    across = np.cross(normal, first)
    local = corners[members] - middle
    order = np.argsort(np.arctan2(local @ across, local @ first), kind="stable")
    loop = [int(members[k]) for k in order]
    turns = [
        np.linalg.norm(np.cross(corners[k] - corners[j], corners[m] - corners[k]))
        for j, k, m in zip([loop[-1], *loop], loop, [*loop[1:], loop[0]], strict=False)
    ]
    return tuple(k for k, turn in zip(loop, turns, strict=True) if turn > PLANE_TOLERANCE)


def _outward(corners: Array, loop: tuple[int, ...]) -> Array:
    a, b, c = (corners[k] for k in loop[:3])
    return np.cross(b - a, c - a)


def _unit(vector: Array) -> Array:
    """Return a unit vector with components ± √(x² / |v|²).

    They are the nearest numbers to √½ and √⅓ where the vector runs along a lattice.
    """
    return np.copysign(np.sqrt(vector * vector / (vector @ vector)), vector) + 0.0


def _signed(unit: Array) -> Array:
    """Return a unit vector or its opposite: the one whose first component is positive."""
    return unit if unit[np.abs(unit) > PLANE_TOLERANCE][0] > 0.0 else 0.0 - unit


def _distinct(units: list[Array]) -> list[Array]:
    """Return unit vectors without those parallel to one before them."""
    lines: list[Array] = []
    for unit in units:
        if all(np.abs(np.cross(unit, line)).max() > PLANE_TOLERANCE for line in lines):
            lines.append(unit)
    return lines


def _face_normals(outward: list[Array]) -> Array:
    """Return the distinct normals of faces, in an order that claims of plans depend on."""
    units = sorted((_unit(v) for v in outward), key=lambda n: (n[0], -n[1], -n[2]))
    return frozen(
        [
            _signed(unit)
            if any(np.abs(unit + other).max() <= PLANE_TOLERANCE for other in units)
            else unit
            for unit in _distinct(units)
        ]
    )


def _edge_directions(edges: list[Array]) -> Array:
    """Return the distinct directions of edges, in an order that claims of plans depend on."""

    def place(unit: Array) -> tuple[float, ...]:
        nonzero = np.flatnonzero(np.abs(unit) > PLANE_TOLERANCE)
        return float(len(nonzero)), float(nonzero[0]), *unit.tolist()

    return frozen(sorted(_distinct([_signed(_unit(v)) for v in edges]), key=place))


@dataclass(frozen=True)
class VolumeMoments:
    """Moments of a body of uniform density.

    Attributes:
        volume: ∫ dV.
        centre: (3,) ∫ x dV / volume.
        inertia: (3, 3) moments of inertia about the centre, for mass 1.
    """

    volume: float
    centre: Array
    inertia: Array


def volume_moments(parts: tuple[Polyhedron, ...]) -> VolumeMoments:
    """Return the moments of polyhedra taken together, from exact sums of their corners.

    A face (a, b, c) and the origin span a tetrahedron of volume d/6, with d = det(a, b, c), and
    ∫ xᵢ xⱼ dV = d/120 (Σ vᵢ vⱼ + sᵢ sⱼ) over its corners v with the sum s (Tonon, Explicit exact
    formulas for the 3-D tetrahedron inertia tensor, 2004).
    """
    # All corners as whole numbers of the same small unit, since sums of fractions are slow.
    coordinates = [[float(x) for x in corner] for part in parts for corner in part.corners]
    scale = max(x.as_integer_ratio()[1] for corner in coordinates for x in corner)
    volume, first, second = 0, [0] * 3, [[0] * 3 for _ in range(3)]
    for part in parts:
        whole = [[int(Fraction(float(x)) * scale) for x in corner] for corner in part.corners]
        for loop in part.loops:
            for k in range(1, len(loop) - 1):
                corners = whole[loop[0]], whole[loop[k]], whole[loop[k + 1]]
                det = _determinant(*corners)
                total = [sum(v[i] for v in corners) for i in range(3)]
                volume += det
                for i in range(3):
                    first[i] += det * total[i]
                    for j in range(3):
                        square = sum(v[i] * v[j] for v in corners) + total[i] * total[j]
                        second[i][j] += det * square
    centre = [Fraction(value, 4 * volume * scale) for value in first]
    spread = [
        [Fraction(second[i][j], 20 * volume * scale**2) - centre[i] * centre[j] for j in range(3)]
        for i in range(3)
    ]
    trace = spread[0][0] + spread[1][1] + spread[2][2]
    inertia = [[(trace if i == j else 0) - spread[i][j] for j in range(3)] for i in range(3)]
    return VolumeMoments(
        float(Fraction(volume, 6 * scale**3)),
        np.array([float(x) for x in centre]),
        np.array([[float(x) for x in row] for row in inertia]),
    )


def _determinant(a: list[int], b: list[int], c: list[int]) -> int:
    return (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        - a[1] * (b[0] * c[2] - b[2] * c[0])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
