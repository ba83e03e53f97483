"""Clearance between convex modules by separating axes, compiled.

For two convex polyhedra the best separating axis is a face normal of one or a cross product of two
edges. The largest separation over those axes is exactly minus the penetration depth when they
overlap, and a lower bound of their distance, never zero or less, when they don't (Gottschalk, Lin,
Manocha: OBBTree, 1996). So its sign decides collision exactly.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels.pairs import near_pairs

Array = NDArray[np.float64]
Pairs = NDArray[np.int64]
ROUNDING = 1e-9
"""What bounds are widened by, so that rounding does not skip the pair that is closest."""


@njit(cache=True)
def _interval(vertices: Array, axis: Array) -> tuple[float, float]:
    low = np.inf
    high = -np.inf
    for k in range(vertices.shape[0]):
        s = vertices[k, 0] * axis[0] + vertices[k, 1] * axis[1] + vertices[k, 2] * axis[2]
        low = min(low, s)
        high = max(high, s)
    return low, high


@njit(cache=True)
def _rotate_transposed(rotation: Array, vector: Array, out: Array) -> None:
    for c in range(3):
        out[c] = (
            rotation[0, c] * vector[0] + rotation[1, c] * vector[1] + rotation[2, c] * vector[2]
        )


@njit(cache=True)
def pair_separation(
    gap: Array,
    rotation_a: Array,
    rotation_b: Array,
    vertices: Array,
    normals: Array,
    edges: Array,
    size: float,
    enough: float,
) -> float:
    """Separation of two equal convex modules, see the top of this file.

    Args:
        gap: (3,) centre of b minus centre of a.
        rotation_a, rotation_b: (3, 3) orientations.
        vertices, normals, edges: The module's hull.
        size: Scale of the hull.
        enough: Stop as soon as the separation is known to be at least this.
    """
    best = -np.inf
    axis = np.empty(3)
    local = np.empty(3)
    axis_a = np.empty(3)
    axis_b = np.empty(3)
    faces = normals.shape[0]
    count = edges.shape[0]
    for k in range(2 * faces + count * count):
        if k < 2 * faces:
            rotation = rotation_a if k < faces else rotation_b
            normal = normals[k % faces]
            for r in range(3):
                axis[r] = (
                    rotation[r, 0] * normal[0]
                    + rotation[r, 1] * normal[1]
                    + rotation[r, 2] * normal[2]
                )
        else:
            ea = edges[(k - 2 * faces) // count]
            eb = edges[(k - 2 * faces) % count]
            for r in range(3):
                axis_a[r] = (
                    rotation_a[r, 0] * ea[0] + rotation_a[r, 1] * ea[1] + rotation_a[r, 2] * ea[2]
                )
                axis_b[r] = (
                    rotation_b[r, 0] * eb[0] + rotation_b[r, 1] * eb[1] + rotation_b[r, 2] * eb[2]
                )
            axis[0] = axis_a[1] * axis_b[2] - axis_a[2] * axis_b[1]
            axis[1] = axis_a[2] * axis_b[0] - axis_a[0] * axis_b[2]
            axis[2] = axis_a[0] * axis_b[1] - axis_a[1] * axis_b[0]
            length = np.sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2])
            if length < 1e-9:
                continue
            for r in range(3):
                axis[r] /= length
        distance = axis[0] * gap[0] + axis[1] * gap[1] + axis[2] * gap[2]
        _rotate_transposed(rotation_a, axis, local)
        low_a, high_a = _interval(vertices, local)
        _rotate_transposed(rotation_b, axis, local)
        low_b, high_b = _interval(vertices, local)
        separation = max(
            distance + size * (low_b - high_a),
            -distance + size * (low_a - high_b),
        )
        if separation > best:
            best = separation
            if best >= enough:
                return best
    return best


@njit(cache=True)
def least_separation(
    positions: Array,
    rotations: Array,
    pairs: Pairs,
    vertices: Array,
    normals: Array,
    edges: Array,
    radius: float,
    size: float,
    enough: float,
) -> tuple[float, int, int]:
    """The least separation over pairs of one configuration, and the pair that has it.

    Pairs known to be at least ``enough`` apart are not looked at closely; when all are, the result
    is ``enough`` with the pair (−1, −1).
    """
    best = enough
    first = -1
    second = -1
    gap = np.empty(3)
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        for r in range(3):
            gap[r] = positions[j, r] - positions[i, r]
        reach = np.sqrt(gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2]) - 2.0 * radius * size
        if reach >= best:
            continue
        separation = pair_separation(
            gap, rotations[i], rotations[j], vertices, normals, edges, size, best
        )
        if separation < best:
            best = separation
            first = i
            second = j
    return best, first, second


@njit(cache=True)
def _relative_motion(
    i: int,
    j: int,
    positions_a: Array,
    rotations_a: Array,
    positions_b: Array,
    rotations_b: Array,
    radius: float,
) -> float:
    """How far any point of module j moves from a to b as seen from module i."""
    moved = 0.0
    for r in range(3):
        at_a = 0.0
        at_b = 0.0
        for k in range(3):
            at_a += rotations_a[i, k, r] * (positions_a[j, k] - positions_a[i, k])
            at_b += rotations_b[i, k, r] * (positions_b[j, k] - positions_b[i, k])
        moved += (at_b - at_a) ** 2
    turned = 0.0
    for r in range(3):
        for c in range(3):
            at_a = 0.0
            at_b = 0.0
            for k in range(3):
                at_a += rotations_a[i, k, r] * rotations_a[j, k, c]
                at_b += rotations_b[i, k, r] * rotations_b[j, k, c]
            turned += (at_b - at_a) ** 2
    return np.sqrt(moved) + radius * np.sqrt(0.5 * turned)


@njit(cache=True)
def _off_chord(
    i: int,
    j: int,
    positions_a: Array,
    rotations_a: Array,
    positions_m: Array,
    rotations_m: Array,
    positions_b: Array,
    rotations_b: Array,
) -> float:
    """How far the centre of module j, seen from module i, is off the chord at its middle."""
    off = 0.0
    for r in range(3):
        at_a = 0.0
        at_m = 0.0
        at_b = 0.0
        for k in range(3):
            at_a += rotations_a[i, k, r] * (positions_a[j, k] - positions_a[i, k])
            at_m += rotations_m[i, k, r] * (positions_m[j, k] - positions_m[i, k])
            at_b += rotations_b[i, k, r] * (positions_b[j, k] - positions_b[i, k])
        off += (at_m - 0.5 * (at_a + at_b)) ** 2
    return np.sqrt(off)


@njit(cache=True)
def between(
    positions_a: Array,
    rotations_a: Array,
    positions_m: Array,
    rotations_m: Array,
    positions_b: Array,
    rotations_b: Array,
    pairs: Pairs,
    vertices: Array,
    normals: Array,
    edges: Array,
    radius: float,
    size: float,
    enough: float,
) -> tuple[float, int, int, float, Pairs]:
    """Clearance of pairs between two configurations a and b, from the one in their middle m.

    While going from a to b a pair's clearance differs from that at m by no more than the pair's
    relative motion from m to either end, plus how far the way leaves the chord.

    Returns:
        Least clearance at m and its pair (``enough`` and (−1, −1) when none is below), the least
        bound over the way of the pairs that passed, and the pairs whose bound is not above zero.
    """
    best = enough
    first = -1
    second = -1
    bound = enough
    open_pairs = np.empty((pairs.shape[0], 2), dtype=np.int64)
    count = 0
    gap = np.empty(3)
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        for r in range(3):
            gap[r] = positions_m[j, r] - positions_m[i, r]
        reach = np.sqrt(gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2]) - 2.0 * radius * size
        motion = max(
            _relative_motion(
                i, j, positions_m, rotations_m, positions_a, rotations_a, radius * size
            ),
            _relative_motion(
                i, j, positions_m, rotations_m, positions_b, rotations_b, radius * size
            ),
        ) + 2.0 * _off_chord(
            i, j, positions_a, rotations_a, positions_m, rotations_m, positions_b, rotations_b
        )
        if reach - motion >= bound and reach >= best:
            continue
        separation = pair_separation(
            gap,
            rotations_m[i],
            rotations_m[j],
            vertices,
            normals,
            edges,
            size,
            max(best, motion + enough),
        )
        if separation < best:
            best = separation
            first = i
            second = j
        if separation - motion <= 0.0:
            open_pairs[count, 0] = i
            open_pairs[count, 1] = j
            count += 1
        else:
            bound = min(bound, separation - motion)
    return best, first, second, bound, open_pairs[:count].copy()


@njit(cache=True)
def module_clearances(
    positions: Array,
    rotations: Array,
    vertices: Array,
    normals: Array,
    edges: Array,
    radius: float,
    inner_radius: float,
    size: float,
    apart: int,
    reach: float,
    clearance: NDArray[np.float32],
    nearest: NDArray[np.int32],
) -> None:
    """Writes every module's least separation from the others in every configuration, and who it is.

    A separation lies between the centres' distance less two radii and less two inner radii, so the
    nearest centre of a module bounds its result, and most pairs need no closer look.

    Args:
        positions: (F, n, 3) centres.
        rotations: (F, n, 3, 3) orientations.
        vertices, normals, edges, radius, inner_radius: The module's hull.
        size: Scale of the hull.
        apart: Pairs fewer links apart don't count.
        reach: Separations of this and more are not told apart.
        clearance: (F, n) written; ``reach`` where nothing is nearer.
        nearest: (F, n) written: the other module of the pair; −1 where nothing is nearer.
    """
    frames, n = positions.shape[:2]
    outer = 2.0 * radius * size
    inner = 2.0 * inner_radius * size
    best = np.empty(n)
    bound = np.empty(n)
    gap = np.empty(3)
    for f in range(frames):
        points = positions[f]
        pairs = near_pairs(points, outer + reach, apart)
        count = pairs.shape[0]
        distances = np.empty(count)
        for i in range(n):
            best[i] = reach
            bound[i] = reach
            nearest[f, i] = -1
        for k in range(count):
            i = pairs[k, 0]
            j = pairs[k, 1]
            dx = points[j, 0] - points[i, 0]
            dy = points[j, 1] - points[i, 1]
            dz = points[j, 2] - points[i, 2]
            distances[k] = np.sqrt(dx * dx + dy * dy + dz * dz)
            most = distances[k] - inner + ROUNDING
            bound[i] = min(bound[i], most)
            bound[j] = min(bound[j], most)
        for k in range(count):
            i = pairs[k, 0]
            j = pairs[k, 1]
            enough = float(max(min(best[i], bound[i]), min(best[j], bound[j])))
            if distances[k] - outer >= enough:
                continue
            for r in range(3):
                gap[r] = points[j, r] - points[i, r]
            separation = pair_separation(
                gap, rotations[f, i], rotations[f, j], vertices, normals, edges, size, enough
            )
            if separation < best[i]:
                best[i] = separation
                nearest[f, i] = j
            if separation < best[j]:
                best[j] = separation
                nearest[f, j] = i
        for i in range(n):
            clearance[f, i] = best[i]
