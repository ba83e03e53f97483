"""Where modules touch the floor and each other, and what forces ask of hinges, compiled.

Two convex modules touch along the axis that separates them best, as in ``clearance``. Is that a
face's normal, the points are the corners of what the two faces have in common; is it across two
edges, there is one point between them.

The moment about a hinge is that of all forces beyond it. Of two forces of a contact between modules
that cancels out for all hinges but those between the two, so that its column is short.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import INNER, KERNEL
from planner.kernels.pairs import near_pairs

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Int32s = NDArray[np.int32]
EDGE_BIAS = 0.01
"""Pitches by which an axis across two edges must separate better than a face's normal does."""
RIM = 0.02
"""What two faces have in common counts from this width on, in pitches: else they touch nowhere."""
SAME = 1e-4
"""Pitches below which two points are one."""
ON_PLANE = 1e-9
"""Pitches up to which a corner lies on the plane that cuts it off."""
MOST_CORNERS = 16
"""Corners that the common part of two faces may have."""


EQUATIONS = 6
"""Rows behind those of the hinges: force and moment of all that acts on a chain that is free."""


class Solid(NamedTuple):
    """A module's hull with its faces and edges, about its centre, in pitches.

    Attributes:
        vertices: (V, 3) corners.
        normals: (F, 3) outward unit normals of its faces.
        loops: (F, M) corners of each face, counterclockwise from outside; −1 behind the last one.
        edges: (E, 2) corners of each edge.
        directions: (D, 3) unit directions of its edges, one of each parallel set.
        radius: Distance from the centre to the farthest corner.
    """

    vertices: Array
    normals: Array
    loops: Ints
    edges: Ints
    directions: Array
    radius: float


class Found(NamedTuple):
    """Contact points.

    Attributes:
        first: (C,) the module that is pushed along the normal.
        second: (C,) the module that is pushed against it; −1 for the floor.
        feature: (C,) tells the points of a pair apart; the same place has the same one in the
            next frame, mostly.
        points: (C, 3) where.
        normals: (C, 3) unit normals.
        gaps: (C,) distance of the two surfaces there; negative where they overlap.
    """

    first: Ints
    second: Ints
    feature: Ints
    points: Array
    normals: Array
    gaps: Array


class Hinges(NamedTuple):
    """The hinges of a configuration, in the world's frame.

    Attributes:
        axes: (J, 3) unit axes.
        anchors: (J, 3) points on them.
        before: (J,) the module before each.
    """

    axes: Array
    anchors: Array
    before: Ints


@njit(**INNER, inline="always")
def _dot(a: Array, b: Array) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(**INNER)
def _best_face(corners: Array, normals: Array, solid: Solid, other: Array) -> tuple[float, int]:
    """The face that separates best from other corners: distance and which one."""
    best, which = -np.inf, 0
    for f in range(normals.shape[0]):
        normal = normals[f]
        least = np.inf
        for v in range(other.shape[0]):
            least = min(least, _dot(normal, other[v]))
        gap = least - _dot(normal, corners[solid.loops[f, 0]])
        if gap > best:
            best, which = gap, f
    return best, which


@njit(**INNER)
def _best_edges(
    corners_a: Array,
    corners_b: Array,
    along_a: Array,
    along_b: Array,
    gap: Array,
    axis: Array,
) -> float:
    """The best separation across two edges; its axis (3,), from a to b, is written."""
    best = -np.inf
    across = np.empty(3)
    for i in range(along_a.shape[0]):
        for j in range(along_b.shape[0]):
            across[0] = along_a[i, 1] * along_b[j, 2] - along_a[i, 2] * along_b[j, 1]
            across[1] = along_a[i, 2] * along_b[j, 0] - along_a[i, 0] * along_b[j, 2]
            across[2] = along_a[i, 0] * along_b[j, 1] - along_a[i, 1] * along_b[j, 0]
            length = np.sqrt(_dot(across, across))
            if length < 1e-3:
                continue
            if _dot(across, gap) < 0.0:
                length = -length
            for r in range(3):
                across[r] /= length
            high, low = -np.inf, np.inf
            for v in range(corners_a.shape[0]):
                high = max(high, _dot(across, corners_a[v]))
                low = min(low, _dot(across, corners_b[v]))
            if low - high > best:
                best = low - high
                for r in range(3):
                    axis[r] = across[r]
    return best


@njit(**INNER)
def _supporting(corners: Array, edges: Ints, axis: Array, sign: float) -> tuple[int, int]:
    """The edge that reaches farthest along plus or minus an axis."""
    best, which = -np.inf, 0
    for e in range(edges.shape[0]):
        s = sign * ((corners[edges[e, 0]] + corners[edges[e, 1]]) * axis).sum()
        if s > best:
            best, which = s, e
    return int(edges[which, 0]), int(edges[which, 1])


@njit(**INNER)
def _between_edges(a0: Array, a1: Array, b0: Array, b1: Array, point: Array) -> bool:
    """Writes the point between two edges; whether they really cross there."""
    u, v, w = a1 - a0, b1 - b0, a0 - b0
    uu, uv, vv = (u * u).sum(), (u * v).sum(), (v * v).sum()
    uw, vw = (u * w).sum(), (v * w).sum()
    scale = uu * vv - uv * uv
    if scale < 1e-12:
        return False
    s = (uv * vw - vv * uw) / scale
    t = (uu * vw - uv * uw) / scale
    if s < -RIM or s > 1.0 + RIM or t < -RIM or t > 1.0 + RIM:
        return False
    point[:] = 0.5 * (a0 + s * u + b0 + t * v)
    return True


@njit(**INNER)
def _clipped(loop: Array, count: int, at: Array, inward: Array, out: Array) -> int:
    """Cuts a polygon (count, 3) off behind a plane; how many corners ``out`` has then."""
    kept = 0
    level = _dot(at, inward)
    for k in range(count):
        p, q = loop[k], loop[(k + 1) % count]
        dp = _dot(p, inward) - level
        dq = _dot(q, inward) - level
        if dp >= -ON_PLANE and kept < MOST_CORNERS:
            for r in range(3):
                out[kept, r] = p[r]
            kept += 1
        crossed = (dp > ON_PLANE and dq < -ON_PLANE) or (dp < -ON_PLANE and dq > ON_PLANE)
        if crossed and kept < MOST_CORNERS:
            share = dp / (dp - dq)
            for r in range(3):
                out[kept, r] = p[r] + (q[r] - p[r]) * share
            kept += 1
    return kept


@njit(**INNER)
def _common_corners(
    face: Ints,
    normal: Array,
    corners: Array,
    other_face: Ints,
    other_corners: Array,
    most: float,
    points: Array,
    gaps: Array,
) -> int:
    """Corners of what two faces have in common, seen along the first one's normal.

    Those farther than ``most`` from the first face are left out, and all are where they make up
    less than ``RIM``. ``points`` (MOST_CORNERS, 3) and ``gaps`` are written.
    """
    loop = np.empty((MOST_CORNERS, 3))
    spare = np.empty((MOST_CORNERS, 3))
    count = 0
    while count < other_face.shape[0] and other_face[count] >= 0:
        loop[count] = other_corners[other_face[count]]
        count += 1
    sides = 0
    while sides < face.shape[0] and face[sides] >= 0:
        sides += 1
    inward = np.empty((sides, 3))
    for k in range(sides):
        p, q = corners[face[k]], corners[face[(k + 1) % sides]]
        inward[k, 0] = normal[1] * (q[2] - p[2]) - normal[2] * (q[1] - p[1])
        inward[k, 1] = normal[2] * (q[0] - p[0]) - normal[0] * (q[2] - p[2])
        inward[k, 2] = normal[0] * (q[1] - p[1]) - normal[1] * (q[0] - p[0])
        length = np.sqrt(_dot(inward[k], inward[k]))
        for r in range(3):
            inward[k, r] /= length
        count = _clipped(loop, count, p, inward[k], spare)
        loop, spare = spare, loop
        if count == 0:
            return 0
    level = _dot(corners[face[0]], normal)
    kept = 0
    for k in range(count):
        gap = _dot(loop[k], normal) - level
        if gap > most:
            continue
        new = True
        for m in range(kept):
            off = 0.0
            for r in range(3):
                off = max(off, abs(points[m, r] + 0.5 * gaps[m] * normal[r] - loop[k, r]))
            if off < SAME:
                new = False
        if new:
            for r in range(3):
                points[kept, r] = loop[k, r] - 0.5 * gap * normal[r]
            gaps[kept] = gap
            kept += 1
    for k in range(sides):
        reach = -np.inf
        for m in range(kept):
            reach = max(reach, _dot(points[m], inward[k]) - _dot(corners[face[k]], inward[k]))
        if reach < RIM:
            return 0
    return kept


@njit(**KERNEL, nogil=True)
def contact_points(
    positions: Array,
    rotations: Array,
    solid: Solid,
    apart: int,
    floor_gap: float,
    module_gap: float,
) -> Found:
    """All contact points of one configuration that stands on the plane z = 0.

    Args:
        positions: (n, 3) centres.
        rotations: (n, 3, 3) orientations.
        solid: Of each module.
        apart: Pairs fewer links apart don't touch.
        floor_gap: Corners up to this high stand on the floor.
        module_gap: Points of two modules touch up to this distance.
    """
    n = positions.shape[0]
    pairs = near_pairs(positions, 2.0 * solid.radius + module_gap, apart)
    room = solid.vertices.shape[0] * n + MOST_CORNERS * pairs.shape[0] + 1
    first = np.empty(room, dtype=np.int64)
    second = np.empty(room, dtype=np.int64)
    feature = np.empty(room, dtype=np.int64)
    points = np.empty((room, 3))
    normals = np.empty((room, 3))
    gaps = np.empty(room)
    corners = np.empty((n, solid.vertices.shape[0], 3))
    faces = np.empty((n, solid.normals.shape[0], 3))
    edges = np.empty((n, solid.directions.shape[0], 3))
    count = 0
    for i in range(n):
        turned = np.ascontiguousarray(rotations[i].T)
        corners[i] = solid.vertices @ turned + positions[i]
        faces[i] = solid.normals @ turned
        edges[i] = solid.directions @ turned
        if positions[i, 2] > solid.radius + floor_gap:
            continue
        for v in range(solid.vertices.shape[0]):
            if corners[i, v, 2] <= floor_gap:
                first[count] = i
                second[count] = -1
                feature[count] = v
                points[count] = corners[i, v]
                normals[count, 0] = 0.0
                normals[count, 1] = 0.0
                normals[count, 2] = 1.0
                gaps[count] = corners[i, v, 2]
                count += 1
    axis = np.empty(3)
    for k in range(pairs.shape[0]):
        i, j = pairs[k, 0], pairs[k, 1]
        of_i, face_i = _best_face(corners[i], faces[i], solid, corners[j])
        if of_i > module_gap:
            continue
        of_j, face_j = _best_face(corners[j], faces[j], solid, corners[i])
        if of_j > module_gap:
            continue
        gap = positions[j] - positions[i]
        across = _best_edges(corners[i], corners[j], edges[i], edges[j], gap, axis)
        if across > module_gap:
            continue
        if across > max(of_i, of_j) + EDGE_BIAS:
            a0, a1 = _supporting(corners[i], solid.edges, axis, 1.0)
            b0, b1 = _supporting(corners[j], solid.edges, axis, -1.0)
            if not _between_edges(
                corners[i, a0], corners[i, a1], corners[j, b0], corners[j, b1], points[count]
            ):
                continue
            first[count] = j
            second[count] = i
            feature[count] = -1
            normals[count] = axis
            gaps[count] = across
            count += 1
            continue
        a, b, face = i, j, face_i
        if of_j > of_i + 1e-6:
            a, b, face = j, i, face_j
        normal = faces[a, face]
        other, least = 0, np.inf
        for f in range(solid.normals.shape[0]):
            against = _dot(faces[b, f], normal)
            if against < least:
                other, least = f, against
        kept = _common_corners(
            solid.loops[face],
            normal,
            corners[a],
            solid.loops[other],
            corners[b],
            module_gap,
            points[count : count + MOST_CORNERS],
            gaps[count : count + MOST_CORNERS],
        )
        for m in range(kept):
            first[count] = b
            second[count] = a
            feature[count] = face * MOST_CORNERS + m
            normals[count] = normal
            count += 1
    return Found(
        first[:count].copy(),
        second[:count].copy(),
        feature[:count].copy(),
        points[:count].copy(),
        normals[:count].copy(),
        gaps[:count].copy(),
    )


@njit(**INNER)
def _turning(axis: Array, anchor: Array, point: Array, force: Array) -> float:
    """The moment of a force about an axis."""
    x, y, z = point[0] - anchor[0], point[1] - anchor[1], point[2] - anchor[2]
    return (
        axis[0] * (y * force[2] - z * force[1])
        + axis[1] * (z * force[0] - x * force[2])
        + axis[2] * (x * force[1] - y * force[0])
    )


@njit(**KERNEL, nogil=True)
def columns(
    hinges: Hinges,
    root: int,
    held: bool,
    first: Ints,
    second: Ints,
    points: Array,
    forces: Array,
) -> tuple[Int32s, Int32s, Array]:
    """What each of C unit forces asks of the hinges, by columns: starts, rows and values.

    A hinge's torque is what the module before it exerts on the one behind. Unless the root is held,
    force and moment on the whole chain follow as ``EQUATIONS`` rows; forces between modules have
    none of them.

    Args:
        hinges: The hinges.
        root: The module from which on hinges are reached; where the root is held that is the one.
        held: Whether the root is held still, by whatever force that takes.
        first: (C,) the module on which a force acts.
        second: (C,) the one on which its opposite acts; negative for none.
        points: (C, 3) where.
        forces: (C, 3) the force on the first.
    """
    count = first.shape[0]
    hinge_count = hinges.before.shape[0]
    room = 16 * (count + 1)
    starts = np.empty(count + 1, dtype=np.int32)
    rows = np.empty(room, dtype=np.int32)
    values = np.empty(room)
    at = 0
    before = hinges.before
    for c in range(count):
        starts[c] = at
        if at + hinge_count + EQUATIONS > room:
            room = 2 * room + hinge_count + EQUATIONS
            larger_rows = np.empty(room, dtype=np.int32)
            larger_rows[:at] = rows[:at]
            rows = larger_rows
            larger_values = np.empty(room)
            larger_values[:at] = values[:at]
            values = larger_values
        i, j = first[c], second[c]
        # Hinges between `low` and `high` feel it; those behind the force lose what is on them.
        low, high = min(i, j if j >= 0 else root), max(i, j if j >= 0 else root)
        sign = -1.0 if i == high else 1.0
        if low == high:
            low = high = -1
        start = np.searchsorted(before, low)
        stop = np.searchsorted(before, high)
        for h in range(start, stop):
            value = sign * _turning(hinges.axes[h], hinges.anchors[h], points[c], forces[c])
            if abs(value) > 1e-12:
                rows[at] = h
                values[at] = value
                at += 1
        if j < 0 and not held:
            x, y, z = points[c, 0], points[c, 1], points[c, 2]
            fx, fy, fz = forces[c, 0], forces[c, 1], forces[c, 2]
            whole = (fx, fy, fz, y * fz - z * fy, z * fx - x * fz, x * fy - y * fx)
            for r in range(EQUATIONS):
                if abs(whole[r]) > 1e-12:
                    rows[at] = hinge_count + r
                    values[at] = whole[r]
                    at += 1
    starts[count] = at
    return starts, rows[:at].copy(), values[:at].copy()
