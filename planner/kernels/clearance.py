"""Clearance between convex modules by separating axes, compiled.

For two convex polyhedra the best separating axis is a face normal of one or a cross product of two
edges. The largest separation over those axes is exactly minus the penetration depth when they
overlap, and a lower bound of their distance, never zero or less, when they don't (Gottschalk, Lin,
Manocha: OBBTree, 1996). So its sign decides collision exactly.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL
from foldback.planner.kernels.module import Hull
from foldback.planner.kernels.pairs import near_pairs

Array = NDArray[np.float64]
Pairs = NDArray[np.int64]
MIN_CROSS = 1e-9
"""Minimum length of the cross product of two unit edges, the sine of their angle, for it to be
tested as a separating axis of two convex modules. Shorter ones belong to parallel edges, which the
face normals cover."""


class Solid(NamedTuple):
    """A module as a solid.

    Attributes:
        hull: Full-size hull.
        size: Scale of the hull.
        inner_radius: Radius of the largest ball about the full-size module's centre that fits into
            it, in pitches.
    """

    hull: Hull
    size: float
    inner_radius: float


@njit(**INNER)
def _interval(vertices: Array, axis: Array) -> tuple[float, float]:
    """Return the least and the largest projection of (V, 3) vertices on an axis."""
    low = np.inf
    high = -np.inf
    for k in range(vertices.shape[0]):
        s = vertices[k, 0] * axis[0] + vertices[k, 1] * axis[1] + vertices[k, 2] * axis[2]
        low = min(low, s)
        high = max(high, s)
    return low, high


@njit(**INNER)
def _rotate(rotation: Array, vector: Array, out: Array) -> None:
    """Write the product of a (3, 3) rotation and a (3,) vector."""
    for r in range(3):
        out[r] = (
            rotation[r, 0] * vector[0] + rotation[r, 1] * vector[1] + rotation[r, 2] * vector[2]
        )


@njit(**INNER)
def _rotate_transposed(rotation: Array, vector: Array, out: Array) -> None:
    """Write the product of the transpose of a (3, 3) rotation and a (3,) vector."""
    for c in range(3):
        out[c] = (
            rotation[0, c] * vector[0] + rotation[1, c] * vector[1] + rotation[2, c] * vector[2]
        )


@njit(**INNER)
def _box_axis_separation(k: int, across: Array, relative: Array, half: Array) -> float:
    """Return the separation of two boxes along candidate axis k of 15; −∞ for parallel edges.

    Candidates are the 3 face normals of a, the 3 of b, and the cross products of edge r of a and
    edge c of b for k = 6 + 3 r + c (Gottschalk, Lin, Manocha 1996).

    Args:
        k: Number of the axis.
        across: (3,) from centre a to centre b, in a's frame.
        relative: (3, 3) rotation of b in a's frame.
        half: (3,) half of the box along its axes.
    """
    scale = 1.0
    if k < 3:
        distance = across[k]
        reach = (
            half[k]
            + abs(relative[k, 0]) * half[0]
            + abs(relative[k, 1]) * half[1]
            + abs(relative[k, 2]) * half[2]
        )
    elif k < 6:
        c = k - 3
        distance = (
            across[0] * relative[0, c] + across[1] * relative[1, c] + across[2] * relative[2, c]
        )
        reach = (
            half[c]
            + abs(relative[0, c]) * half[0]
            + abs(relative[1, c]) * half[1]
            + abs(relative[2, c]) * half[2]
        )
    else:
        r, c = (k - 6) // 3, (k - 6) % 3
        r1, r2, c1, c2 = (r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3
        scale = relative[r1, c] * relative[r1, c] + relative[r2, c] * relative[r2, c]
        if scale < 1e-18:  # the square of MIN_CROSS
            return -np.inf
        scale = 1.0 / np.sqrt(scale)
        distance = across[r2] * relative[r1, c] - across[r1] * relative[r2, c]
        reach = (
            half[r1] * abs(relative[r2, c])
            + half[r2] * abs(relative[r1, c])
            + half[c1] * abs(relative[r, c2])
            + half[c2] * abs(relative[r, c1])
        )
    return (abs(distance) - reach) * scale


@njit(**INNER)
def _write_box_axis(
    k: int, rotation_a: Array, rotation_b: Array, relative: Array, axis: Array
) -> None:
    """Write the (3,) unit vector of candidate axis k of ``_box_axis_separation``."""
    for x in range(3):
        if k < 3:
            axis[x] = rotation_a[x, k]
        elif k < 6:
            axis[x] = rotation_b[x, k - 3]
        else:
            r, c = (k - 6) // 3, (k - 6) % 3
            r1, r2 = (r + 1) % 3, (r + 2) % 3
            scale = np.sqrt(relative[r1, c] * relative[r1, c] + relative[r2, c] * relative[r2, c])
            axis[x] = (
                relative[r1, c] * rotation_a[x, r2] - relative[r2, c] * rotation_a[x, r1]
            ) / scale


@njit(**INNER)
def _box_separation(
    gap: Array, rotation_a: Array, rotation_b: Array, half: Array, enough: float, best_axis: Array
) -> float:
    """``separation_along`` for two boxes about their centres, ``half`` (3,) as wide each way."""
    relative = np.empty((3, 3))
    across = np.empty(3)
    best = -np.inf
    best_k = 0
    _rotate_transposed(rotation_a, gap, across)
    for r in range(3):
        for c in range(3):
            relative[r, c] = (
                rotation_a[0, r] * rotation_b[0, c]
                + rotation_a[1, r] * rotation_b[1, c]
                + rotation_a[2, r] * rotation_b[2, c]
            )
    for k in range(15):
        separation = _box_axis_separation(k, across, relative, half)
        if separation > best:
            best = separation
            best_k = k
            if best >= enough:
                break
    _write_box_axis(best_k, rotation_a, rotation_b, relative, best_axis)
    return best


@njit(**INNER)
def _is_box(hull: Hull) -> bool:
    """Return True if the hull is a box along its own axes, about its centre."""
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
    edge_a = np.empty(3)
    edge_b = np.empty(3)
    faces = normals.shape[0]
    count = edges.shape[0]
    for k in range(2 * faces + count * count):
        if k < 2 * faces:
            rotation = rotation_a if k < faces else rotation_b
            _rotate(rotation, normals[k % faces], axis)
        else:
            _rotate(rotation_a, edges[(k - 2 * faces) // count], edge_a)
            _rotate(rotation_b, edges[(k - 2 * faces) % count], edge_b)
            axis[0] = edge_a[1] * edge_b[2] - edge_a[2] * edge_b[1]
            axis[1] = edge_a[2] * edge_b[0] - edge_a[0] * edge_b[2]
            axis[2] = edge_a[0] * edge_b[1] - edge_a[1] * edge_b[0]
            length = np.sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2])
            if length < MIN_CROSS:
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
    """Return the separation of two equal convex modules, see the top of this file.

    Args:
        gap: (3,) centre of b minus centre of a, in pitches.
        rotation_a, rotation_b: (3, 3) orientations.
        hull: Full-size hull of both modules.
        size: Scale of the hull.
        enough: Pitches; the search stops when the separation is known to be at least this.
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
    """Return the least separation over pairs of one configuration, and the pair that has it.

    If all pairs are at least ``enough`` apart, the result is ``enough`` with the pair (−1, −1).

    Args:
        positions, rotations: (n, 3) centres in pitches, (n, 3, 3) orientations.
        pairs: (P, 2) modules.
        hull, size: Full-size hull of each module, and its scale.
        enough: Pitches from which on separations are not told apart.
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
    solid: Solid,
    min_checked_gap: int,
    cutoff: float,
    clearance: NDArray[np.float32],
    nearest: NDArray[np.int32],
) -> None:
    """Write the least separation of every module in every configuration, and the other module.

    A separation lies between the centres' distance less two radii and less two inner radii, so the
    nearest centre of a module bounds its result, and most pairs need no separating axes.

    Args:
        positions: (F, n, 3) centres.
        rotations: (F, n, 3, 3) orientations.
        solid: Each module.
        min_checked_gap: Pairs fewer links apart don't count.
        cutoff: Pitches from which on separations are not told apart.
        clearance: (F, n) written; ``cutoff`` where nothing is nearer.
        nearest: (F, n) written: the other module of the pair; −1 where nothing is nearer.
    """
    frames, n = positions.shape[:2]
    hull, size = solid.hull, solid.size
    outer = 2.0 * hull.radius * size
    inner = 2.0 * solid.inner_radius * size
    best = np.empty(n)
    bound = np.empty(n)
    gap = np.empty(3)
    for f in range(frames):
        points = positions[f]
        pairs = near_pairs(points, outer + cutoff, min_checked_gap)
        count = pairs.shape[0]
        distances = np.empty(count)
        for i in range(n):
            best[i] = cutoff
            bound[i] = cutoff
            nearest[f, i] = -1
        for k in range(count):
            i = pairs[k, 0]
            j = pairs[k, 1]
            dx = points[j, 0] - points[i, 0]
            dy = points[j, 1] - points[i, 1]
            dz = points[j, 2] - points[i, 2]
            distances[k] = np.sqrt(dx * dx + dy * dy + dz * dz)
            upper_bound = distances[k] - inner + 1e-9  # rounding
            bound[i] = min(bound[i], upper_bound)
            bound[j] = min(bound[j], upper_bound)
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
