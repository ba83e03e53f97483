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

from planner.kernels import INNER, KERNEL
from planner.kernels.module import Hull
from planner.kernels.pairs import near_pairs

Array = NDArray[np.float64]
Pairs = NDArray[np.int64]
ROUNDING = 1e-9
"""Pitches that bounds are widened by, so that rounding skips no pair that may be the closest."""


@njit(**INNER)
def _interval(vertices: Array, axis: Array) -> tuple[float, float]:
    low = np.inf
    high = -np.inf
    for k in range(vertices.shape[0]):
        s = vertices[k, 0] * axis[0] + vertices[k, 1] * axis[1] + vertices[k, 2] * axis[2]
        low = min(low, s)
        high = max(high, s)
    return low, high


@njit(**INNER)
def _rotate_transposed(rotation: Array, vector: Array, out: Array) -> None:
    for c in range(3):
        out[c] = (
            rotation[0, c] * vector[0] + rotation[1, c] * vector[1] + rotation[2, c] * vector[2]
        )


@njit(**INNER)
def _box_separation(
    gap: Array, rotation_a: Array, rotation_b: Array, half: Array, enough: float, best_axis: Array
) -> float:
    """``separation_along`` for two boxes about their centres, ``half`` (3,) as wide each way."""
    seen = np.empty((3, 3))
    across = np.empty(3)
    best = -np.inf
    which = 0
    for r in range(3):
        across[r] = (
            rotation_a[0, r] * gap[0] + rotation_a[1, r] * gap[1] + rotation_a[2, r] * gap[2]
        )
        for c in range(3):
            seen[r, c] = (
                rotation_a[0, r] * rotation_b[0, c]
                + rotation_a[1, r] * rotation_b[1, c]
                + rotation_a[2, r] * rotation_b[2, c]
            )
    for k in range(15):
        scale = 1.0
        if k < 3:
            distance = across[k]
            reach = (
                half[k]
                + abs(seen[k, 0]) * half[0]
                + abs(seen[k, 1]) * half[1]
                + abs(seen[k, 2]) * half[2]
            )
        elif k < 6:
            c = k - 3
            distance = across[0] * seen[0, c] + across[1] * seen[1, c] + across[2] * seen[2, c]
            reach = (
                half[c]
                + abs(seen[0, c]) * half[0]
                + abs(seen[1, c]) * half[1]
                + abs(seen[2, c]) * half[2]
            )
        else:
            r, c = (k - 6) // 3, (k - 6) % 3
            r1, r2, c1, c2 = (r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3
            scale = seen[r1, c] * seen[r1, c] + seen[r2, c] * seen[r2, c]
            if scale < 1e-18:
                continue
            scale = 1.0 / np.sqrt(scale)
            distance = across[r2] * seen[r1, c] - across[r1] * seen[r2, c]
            reach = (
                half[r1] * abs(seen[r2, c])
                + half[r2] * abs(seen[r1, c])
                + half[c1] * abs(seen[r, c2])
                + half[c2] * abs(seen[r, c1])
            )
        separation = (abs(distance) - reach) * scale
        if separation > best:
            best = separation
            which = k
            if best >= enough:
                break
    for x in range(3):
        if which < 3:
            best_axis[x] = rotation_a[x, which]
        elif which < 6:
            best_axis[x] = rotation_b[x, which - 3]
        else:
            r, c = (which - 6) // 3, (which - 6) % 3
            r1, r2 = (r + 1) % 3, (r + 2) % 3
            scale = np.sqrt(seen[r1, c] * seen[r1, c] + seen[r2, c] * seen[r2, c])
            best_axis[x] = (
                seen[r1, c] * rotation_a[x, r2] - seen[r2, c] * rotation_a[x, r1]
            ) / scale
    return best


@njit(**INNER)
def _is_box(hull: Hull) -> bool:
    """Whether the hull is a box along its own axes, about its centre."""
    vertices, normals, edges = hull.vertices, hull.normals, hull.edges
    if vertices.shape[0] != 8 or normals.shape[0] != 3 or edges.shape[0] != 3:
        return False
    upright = normals[0, 0] == 1.0 and normals[1, 1] == 1.0 and normals[2, 2] == 1.0
    for r in range(3):
        upright = upright and vertices[0, r] + vertices[7, r] == 0.0
    return upright


@njit(**INNER)
def separation_along(
    gap: Array,
    rotation_a: Array,
    rotation_b: Array,
    hull: Hull,
    size: float,
    enough: float,
    best_axis: Array,
) -> float:
    """``pair_separation`` that also writes the unit axis (3,) which shows the separation."""
    vertices, normals, edges = hull.vertices, hull.normals, hull.edges
    if _is_box(hull):
        half = np.empty(3)
        for r in range(3):
            half[r] = abs(vertices[0, r]) * size
        return _box_separation(gap, rotation_a, rotation_b, half, enough, best_axis)
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
            for r in range(3):
                best_axis[r] = axis[r]
            if best >= enough:
                return best
    return best


@njit(**KERNEL)
def pair_separation(
    gap: Array,
    rotation_a: Array,
    rotation_b: Array,
    hull: Hull,
    size: float,
    enough: float,
) -> float:
    """Separation of two equal convex modules, see the top of this file.

    Args:
        gap: (3,) centre of b minus centre of a.
        rotation_a, rotation_b: (3, 3) orientations.
        hull: Of both modules.
        size: Scale of the hull.
        enough: Stop as soon as the separation is known to be at least this.
    """
    return separation_along(gap, rotation_a, rotation_b, hull, size, enough, np.empty(3))


@njit(**KERNEL)
def least_separation(
    positions: Array,
    rotations: Array,
    pairs: Pairs,
    hull: Hull,
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
        reach = (
            np.sqrt(gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2]) - 2.0 * hull.radius * size
        )
        if reach >= best:
            continue
        separation = pair_separation(gap, rotations[i], rotations[j], hull, size, best)
        if separation < best:
            best = separation
            first = i
            second = j
    return best, first, second


@njit(**KERNEL, nogil=True)
def module_clearances(
    positions: Array,
    rotations: Array,
    hull: Hull,
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
        hull: Of each module.
        inner_radius: Of the ball about a module's centre that fits into it.
        size: Scale of the hull.
        apart: Pairs fewer links apart don't count.
        reach: Separations of this and more are not told apart.
        clearance: (F, n) written; ``reach`` where nothing is nearer.
        nearest: (F, n) written: the other module of the pair; −1 where nothing is nearer.
    """
    frames, n = positions.shape[:2]
    outer = 2.0 * hull.radius * size
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
            separation = pair_separation(gap, rotations[f, i], rotations[f, j], hull, size, enough)
            if separation < best[i]:
                best[i] = separation
                nearest[f, i] = j
            if separation < best[j]:
                best[j] = separation
                nearest[f, j] = i
        for i in range(n):
            clearance[f, i] = best[i]
