"""Contact points of modules with the floor and each other, and hinge torques of forces.

Compiled. Two convex modules touch along the axis that separates them best, as in ``clearance``. If
that is a face's normal, the points are the corners of the intersection of the two faces; if it is
across two edges, there is one point between them.

The torque of a hinge is the moment of all forces beyond it. The two forces of a contact between
modules cancel for all hinges but those between the two, so that its column is sparse.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL
from foldback.planner.kernels.pairs import near_pairs

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Int32s = NDArray[np.int32]
MIN_OVERLAP_WIDTH = 0.02
"""Minimum width in pitches of the area that two opposite faces share for them to count as touching;
it is also the fraction of their length by which two edges may cross beyond their ends."""
PLANE_TOLERANCE = 1e-9
"""Distance in pitches up to which a polygon's corner counts as lying on the plane that clips the
polygon, and is kept. With smaller values rounding adds nearly equal corners."""
MIN_TORQUE = 1e-12
"""Magnitude of the torque of a unit force at a hinge, in pitches, below which it counts as zero and
is left out of the sparse matrix of the force balance."""
MAX_CORNERS = 16
"""Maximum number of corners of the area that two touching faces share, each of which is a contact
point; further ones are dropped."""
EQUATIONS = 6
"""Number of rows that the balance of a chain that is not held has besides one for each hinge: three
for the sum of the forces and three for the sum of the moments."""


class FacetedHull(NamedTuple):
    """Hull of a module with its faces and edges, about its centre, in pitches.

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


class ContactPoints(NamedTuple):
    """Contact points of a configuration.

    Attributes:
        first: (C,) modules that are pushed along the normals.
        second: (C,) modules that are pushed against them; −1 for the floor.
        feature: (C,) identifies a point of a pair, mostly with the same number in the next frame.
        points: (C, 3) points, in pitches.
        normals: (C, 3) unit normals.
        gaps: (C,) distances of the two surfaces, in pitches; negative where they overlap.
    """

    first: Ints
    second: Ints
    feature: Ints
    points: Array
    normals: Array
    gaps: Array


class Hinges(NamedTuple):
    """Hinges of a configuration, in the world frame.

    Attributes:
        axes: (J, 3) unit axes.
        anchors: (J, 3) points on them.
        before: (J,) modules before them.
    """

    axes: Array
    anchors: Array
    before: Ints


@njit(**INNER, inline="always")
def _dot(a: Array, b: Array) -> float:
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(**INNER)
def _best_face(
    corners: Array, normals: Array, solid: FacetedHull, opposite: Array
) -> tuple[float, int]:
    """Return the distance by which one face separates a module best from other corners, and it."""
    best, best_face = -np.inf, 0
    for f in range(normals.shape[0]):
        normal = normals[f]
        nearest = np.inf
        for v in range(opposite.shape[0]):
            nearest = min(nearest, _dot(normal, opposite[v]))
        gap = nearest - _dot(normal, corners[solid.loops[f, 0]])
        if gap > best:
            best, best_face = gap, f
    return best, best_face


@njit(**INNER)
def _best_edges(
    corners_a: Array,
    corners_b: Array,
    along_a: Array,
    along_b: Array,
    gap: Array,
    axis: Array,
) -> float:
    """Return the best separation across two edges; write its (3,) axis, from a to b."""
    best = -np.inf
    across = np.empty(3)
    for i in range(along_a.shape[0]):
        for j in range(along_b.shape[0]):
            across[0] = along_a[i, 1] * along_b[j, 2] - along_a[i, 2] * along_b[j, 1]
            across[1] = along_a[i, 2] * along_b[j, 0] - along_a[i, 0] * along_b[j, 2]
            across[2] = along_a[i, 0] * along_b[j, 1] - along_a[i, 1] * along_b[j, 0]
            length = np.sqrt(_dot(across, across))
            if length < 1e-3:  # parallel
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
    """Return the edge that extends farthest along plus or minus an axis, as two corners."""
    best, best_edge = -np.inf, 0
    for e in range(edges.shape[0]):
        s = sign * ((corners[edges[e, 0]] + corners[edges[e, 1]]) * axis).sum()
        if s > best:
            best, best_edge = s, e
    return int(edges[best_edge, 0]), int(edges[best_edge, 1])


@njit(**INNER)
def _between_edges(a0: Array, a1: Array, b0: Array, b1: Array, point: Array) -> bool:
    """Write the point halfway between two edges; return True if it lies on both."""
    u, v, w = a1 - a0, b1 - b0, a0 - b0
    uu, uv, vv = (u * u).sum(), (u * v).sum(), (v * v).sum()
    uw, vw = (u * w).sum(), (v * w).sum()
    scale = uu * vv - uv * uv
    if scale < 1e-12:  # parallel, without a single closest point
        return False
    s = (uv * vw - vv * uw) / scale
    t = (uu * vw - uv * uw) / scale
    if min(s, t) < -MIN_OVERLAP_WIDTH or max(s, t) > 1.0 + MIN_OVERLAP_WIDTH:
        return False
    point[:] = 0.5 * (a0 + s * u + b0 + t * v)
    return True


@njit(**INNER)
def _clip(loop: Array, count: int, point: Array, inward: Array, out: Array) -> int:
    """Write the part of a polygon in front of a plane; return its number of corners.

    Args:
        loop: (MAX_CORNERS, 3) corners of the polygon, of which ``count`` are used.
        count: Number of its corners.
        point, inward: (3,) point and normal of the plane.
        out: (MAX_CORNERS, 3) written.
    """
    corner_count = 0
    level = _dot(point, inward)
    for k in range(count):
        p, q = loop[k], loop[(k + 1) % count]
        dp = _dot(p, inward) - level
        dq = _dot(q, inward) - level
        if dp >= -PLANE_TOLERANCE and corner_count < MAX_CORNERS:
            for r in range(3):
                out[corner_count, r] = p[r]
            corner_count += 1
        crossed = (dp > PLANE_TOLERANCE and dq < -PLANE_TOLERANCE) or (
            dp < -PLANE_TOLERANCE and dq > PLANE_TOLERANCE
        )
        if crossed and corner_count < MAX_CORNERS:
            fraction = dp / (dp - dq)
            for r in range(3):
                out[corner_count, r] = p[r] + (q[r] - p[r]) * fraction
            corner_count += 1
    return corner_count


@njit(**INNER)
def _inward_normals(face: Ints, normal: Array, corners: Array) -> Array:
    """Return (sides, 3) unit vectors in a face's plane, across its sides, towards its inside."""
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
    return inward


@njit(**INNER)
def _is_new(point: Array, points: Array, gaps: Array, normal: Array, count: int) -> bool:
    """Return True if a corner is none of those that the contact points were made of."""
    for m in range(count):
        distance = 0.0
        for r in range(3):
            corner = points[m, r] + 0.5 * gaps[m] * normal[r]
            distance = max(distance, abs(corner - point[r]))
        if distance < 1e-4:
            return False
    return True


@njit(**INNER)
def _write_common_corners(
    face: Ints,
    normal: Array,
    corners: Array,
    other_face: Ints,
    other_corners: Array,
    max_gap: float,
    points: Array,
    gaps: Array,
) -> int:
    """Write the corners of the intersection of two faces, seen along the first one's normal.

    Args:
        face: Corners of the first face, as in ``FacetedHull.loops``.
        normal: (3,) its normal.
        corners: (V, 3) corners of its module.
        other_face, other_corners: Those of the second face.
        max_gap: Corners farther from the first face, in pitches, are left out.
        points: (MAX_CORNERS, 3) written: halfway between both faces.
        gaps: (MAX_CORNERS,) written: distances from the first face.

    Returns:
        Number of corners; 0 if the intersection is narrower than ``MIN_OVERLAP_WIDTH``.
    """
    loop = np.empty((MAX_CORNERS, 3))
    spare = np.empty((MAX_CORNERS, 3))
    count = 0
    while count < other_face.shape[0] and other_face[count] >= 0:
        loop[count] = other_corners[other_face[count]]
        count += 1
    inward = _inward_normals(face, normal, corners)
    for k in range(inward.shape[0]):
        count = _clip(loop, count, corners[face[k]], inward[k], spare)
        loop, spare = spare, loop
        if count == 0:
            return 0
    level = _dot(corners[face[0]], normal)
    point_count = 0
    for k in range(count):
        gap = _dot(loop[k], normal) - level
        if gap <= max_gap and _is_new(loop[k], points, gaps, normal, point_count):
            for r in range(3):
                points[point_count, r] = loop[k, r] - 0.5 * gap * normal[r]
            gaps[point_count] = gap
            point_count += 1
    for k in range(inward.shape[0]):
        width = -np.inf
        for m in range(point_count):
            width = max(width, _dot(points[m], inward[k]) - _dot(corners[face[k]], inward[k]))
        if width < MIN_OVERLAP_WIDTH:
            return 0
    return point_count


class _PlacedHulls(NamedTuple):
    """Hulls of n modules in the world frame.

    Attributes:
        positions: (n, 3) centres.
        corners: (n, V, 3) corners.
        normals: (n, F, 3) outward normals of the faces.
        directions: (n, D, 3) directions of the edges.
    """

    positions: Array
    corners: Array
    normals: Array
    directions: Array


@njit(**INNER)
def _placed_hulls(positions: Array, rotations: Array, solid: FacetedHull) -> _PlacedHulls:
    """Return the hulls of modules at (n, 3) centres and (n, 3, 3) orientations."""
    n = positions.shape[0]
    corners = np.empty((n, solid.vertices.shape[0], 3))
    normals = np.empty((n, solid.normals.shape[0], 3))
    directions = np.empty((n, solid.directions.shape[0], 3))
    for i in range(n):
        transposed = np.ascontiguousarray(rotations[i].T)
        corners[i] = solid.vertices @ transposed + positions[i]
        normals[i] = solid.normals @ transposed
        directions[i] = solid.directions @ transposed
    return _PlacedHulls(positions, corners, normals, directions)


@njit(**INNER)
def _add_floor_points(
    i: int, corners: Array, floor_gap: float, count: int, out: ContactPoints
) -> int:
    """Write the contact points of module i with the floor; return their number with the others.

    Args:
        i: Index of the module.
        corners: (V, 3) its corners.
        floor_gap: Largest height of a corner that touches, in pitches.
        count: Number of contact points so far.
        out: Written from ``count`` on.
    """
    for v in range(corners.shape[0]):
        if corners[v, 2] <= floor_gap:
            out.first[count] = i
            out.second[count] = -1
            out.feature[count] = v
            out.points[count] = corners[v]
            out.normals[count, 0] = 0.0
            out.normals[count, 1] = 0.0
            out.normals[count, 2] = 1.0
            out.gaps[count] = corners[v, 2]
            count += 1
    return count


@njit(**INNER)
def _add_module_points(
    pairs: Ints,
    hulls: _PlacedHulls,
    solid: FacetedHull,
    module_gap: float,
    count: int,
    out: ContactPoints,
) -> int:
    """Write the contact points between modules; return their number with the others.

    Args:
        pairs: (P, 2) near pairs of modules.
        hulls: Hulls of all modules.
        solid: Hull of a module.
        module_gap: Largest distance of two modules that touch, in pitches.
        count: Number of contact points so far.
        out: Written from ``count`` on.
    """
    positions, corners, normals, directions = hulls
    axis = np.empty(3)
    for k in range(pairs.shape[0]):
        i, j = pairs[k, 0], pairs[k, 1]
        gap_i, face_i = _best_face(corners[i], normals[i], solid, corners[j])
        if gap_i > module_gap:
            continue
        gap_j, face_j = _best_face(corners[j], normals[j], solid, corners[i])
        if gap_j > module_gap:
            continue
        between = positions[j] - positions[i]
        gap = _best_edges(corners[i], corners[j], directions[i], directions[j], between, axis)
        if gap > module_gap:
            continue
        if gap <= max(gap_i, gap_j) + 0.01:  # edges touch only if clearly better than faces
            first, second, face = i, j, face_i
            if gap_j > gap_i + 1e-6:  # rounding must not swap them from frame to frame
                first, second, face = j, i, face_j
            count = _add_face_points(first, second, face, hulls, solid, module_gap, count, out)
            continue
        a0, a1 = _supporting(corners[i], solid.edges, axis, 1.0)
        b0, b1 = _supporting(corners[j], solid.edges, axis, -1.0)
        if _between_edges(
            corners[i, a0], corners[i, a1], corners[j, b0], corners[j, b1], out.points[count]
        ):
            out.first[count] = j
            out.second[count] = i
            out.feature[count] = -1
            out.normals[count] = axis
            out.gaps[count] = gap
            count += 1
    return count


@njit(**INNER)
def _add_face_points(
    a: int,
    b: int,
    face: int,
    hulls: _PlacedHulls,
    solid: FacetedHull,
    module_gap: float,
    count: int,
    out: ContactPoints,
) -> int:
    """Write the contact points of a face of module a with module b; see ``_add_module_points``."""
    normal = hulls.normals[a, face]
    facing, min_cosine = 0, np.inf
    for f in range(solid.normals.shape[0]):
        cosine = _dot(hulls.normals[b, f], normal)
        if cosine < min_cosine:
            facing, min_cosine = f, cosine
    added = _write_common_corners(
        solid.loops[face],
        normal,
        hulls.corners[a],
        solid.loops[facing],
        hulls.corners[b],
        module_gap,
        out.points[count : count + MAX_CORNERS],
        out.gaps[count : count + MAX_CORNERS],
    )
    for m in range(added):
        out.first[count + m] = b
        out.second[count + m] = a
        out.feature[count + m] = face * MAX_CORNERS + m
        out.normals[count + m] = normal
    return count + added


@njit(**KERNEL, nogil=True)
def contact_points(
    positions: Array,
    rotations: Array,
    solid: FacetedHull,
    apart: int,
    floor_gap: float,
    module_gap: float,
) -> ContactPoints:
    """Return all contact points of one configuration that stands on the plane z = 0.

    Args:
        positions: (n, 3) centres, in pitches.
        rotations: (n, 3, 3) orientations.
        solid: Hull of a module.
        apart: Pairs fewer links apart are exempt.
        floor_gap: Largest height of a corner that stands on the floor, in pitches.
        module_gap: Largest distance of two modules that touch, in pitches.
    """
    n = positions.shape[0]
    pairs = near_pairs(positions, 2.0 * solid.radius + module_gap, apart)
    capacity = solid.vertices.shape[0] * n + MAX_CORNERS * pairs.shape[0] + 1
    out = ContactPoints(
        np.empty(capacity, dtype=np.int64),
        np.empty(capacity, dtype=np.int64),
        np.empty(capacity, dtype=np.int64),
        np.empty((capacity, 3)),
        np.empty((capacity, 3)),
        np.empty(capacity),
    )
    hulls = _placed_hulls(positions, rotations, solid)
    count = 0
    for i in range(n):
        if positions[i, 2] <= solid.radius + floor_gap:
            count = _add_floor_points(i, hulls.corners[i], floor_gap, count, out)
    count = _add_module_points(pairs, hulls, solid, module_gap, count, out)
    return ContactPoints(
        out.first[:count].copy(),
        out.second[:count].copy(),
        out.feature[:count].copy(),
        out.points[:count].copy(),
        out.normals[:count].copy(),
        out.gaps[:count].copy(),
    )


@njit(**INNER)
def _moment(axis: Array, anchor: Array, point: Array, force: Array) -> float:
    """Return the moment of a force about an axis."""
    x, y, z = point[0] - anchor[0], point[1] - anchor[1], point[2] - anchor[2]
    return (
        axis[0] * (y * force[2] - z * force[1])
        + axis[1] * (z * force[0] - x * force[2])
        + axis[2] * (x * force[1] - y * force[0])
    )


@njit(**KERNEL, nogil=True)
def torque_columns(
    hinges: Hinges,
    root: int,
    is_clamped: bool,
    first: Ints,
    second: Ints,
    points: Array,
    forces: Array,
) -> tuple[Int32s, Int32s, Array]:
    """Return the hinge torques that balance each of C forces, as sparse columns.

    A hinge's torque is what the module before it exerts on the one behind. Unless the root is held,
    force and moment on the whole chain follow as ``EQUATIONS`` rows; forces between modules have
    none of them.

    Args:
        hinges: Hinges of the configuration.
        root: Module from which the forces are reached along the chain; the held one, if any.
        is_clamped: True if the root is held still, by any force that this needs.
        first: (C,) modules on which the forces act.
        second: (C,) modules on which their opposites act; negative for none.
        points: (C, 3) points at which they act, in pitches.
        forces: (C, 3) forces on the first modules.

    Returns:
        (C + 1,) starts of the columns, and row and value of each element.
    """
    count = first.shape[0]
    hinge_count = hinges.before.shape[0]
    capacity = 16 * (count + 1)
    starts = np.empty(count + 1, dtype=np.int32)
    rows = np.empty(capacity, dtype=np.int32)
    values = np.empty(capacity)
    size = 0
    before = hinges.before
    for c in range(count):
        starts[c] = size
        if size + hinge_count + EQUATIONS > capacity:
            capacity = 2 * capacity + hinge_count + EQUATIONS
            larger_rows = np.empty(capacity, dtype=np.int32)
            larger_rows[:size] = rows[:size]
            rows = larger_rows
            larger_values = np.empty(capacity)
            larger_values[:size] = values[:size]
            values = larger_values
        i, j = first[c], second[c]
        # Only hinges between `low` and `high` transmit it, with a sign that depends on the side.
        low, high = min(i, j if j >= 0 else root), max(i, j if j >= 0 else root)
        sign = -1.0 if i == high else 1.0
        if low == high:
            low = high = -1
        start = np.searchsorted(before, low)
        stop = np.searchsorted(before, high)
        for h in range(start, stop):
            value = sign * _moment(hinges.axes[h], hinges.anchors[h], points[c], forces[c])
            if abs(value) > MIN_TORQUE:
                rows[size] = h
                values[size] = value
                size += 1
        if j < 0 and not is_clamped:
            x, y, z = points[c, 0], points[c, 1], points[c, 2]
            fx, fy, fz = forces[c, 0], forces[c, 1], forces[c, 2]
            wrench = (fx, fy, fz, y * fz - z * fy, z * fx - x * fz, x * fy - y * fx)
            for r in range(EQUATIONS):
                if abs(wrench[r]) > MIN_TORQUE:
                    rows[size] = hinge_count + r
                    values[size] = wrench[r]
                    size += 1
    starts[count] = size
    return starts, rows[:size].copy(), values[:size].copy()
