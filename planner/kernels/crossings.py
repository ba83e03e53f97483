"""Which samples lie inside a mesh, and how full the windows of samples are, compiled."""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL

Array = NDArray[Any]


@njit(**INNER)
def _side(u: float, v: float, a: int, b: int, us: Array, vs: Array) -> float:
    """On which side of an edge a sample lies; both triangles of the edge get the same answer."""
    if a < b:
        side = (us[b] - us[a]) * (v - vs[a]) - (vs[b] - vs[a]) * (u - us[a])
        return side if side != 0.0 else 1e-300
    side = (us[a] - us[b]) * (v - vs[b]) - (vs[a] - vs[b]) * (u - us[b])
    return -side if side != 0.0 else -1e-300


@njit(**KERNEL)
def mark_crossings(us: Array, vs: Array, ws: Array, faces: Array, marks: Array) -> None:
    """Marks where rays along w, one for each sample (u, v), go into and out of a mesh.

    Args:
        us, vs, ws: (V,) coordinates of the vertices, in samples.
        faces: (F, 3) triangles.
        marks: (U, V, W) int16, added to: +1 at the first sample behind a triangle that is entered,
            −1 where it is left.
    """
    count_u, count_v, count_w = marks.shape
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        low_u = int(np.floor(min(us[a], us[b], us[c]) - 0.5))
        high_u = int(np.ceil(max(us[a], us[b], us[c]) - 0.5))
        low_v = int(np.floor(min(vs[a], vs[b], vs[c]) - 0.5))
        high_v = int(np.ceil(max(vs[a], vs[b], vs[c]) - 0.5))
        for i in range(max(low_u, 0), min(high_u + 1, count_u)):
            u = i + 0.5 + 1.3e-6  # no ray hits an edge of a box-shaped mesh
            for j in range(max(low_v, 0), min(high_v + 1, count_v)):
                # Another shift than along u: no ray hits a diagonal edge of a box-shaped mesh
                # either.
                v = j + 0.5 + 2.9e-6
                ab = _side(u, v, a, b, us, vs)
                bc = _side(u, v, b, c, us, vs)
                if (ab > 0.0) != (bc > 0.0):
                    continue
                ca = _side(u, v, c, a, us, vs)
                if (ab > 0.0) != (ca > 0.0):
                    continue
                w = (bc * ws[a] + ca * ws[b] + ab * ws[c]) / (ab + bc + ca)
                w = min(max(w, min(ws[a], ws[b], ws[c])), max(ws[a], ws[b], ws[c]))
                k = max(int(np.ceil(w - 0.5)), 0)
                if k < count_w:
                    # Seen along +w, the outside of a triangle that is entered points to −w.
                    marks[i, j, k] += -1 if ab > 0.0 else 1


@njit(**KERNEL)
def fill_by_winding(marks: Array, inside: Array) -> int:
    """Sets the samples that the mesh goes around, and counts those with more than one turn."""
    twice = 0
    for i in range(marks.shape[0]):
        for j in range(marks.shape[1]):
            turns = 0
            for k in range(marks.shape[2]):
                turns += marks[i, j, k]
                inside[i, j, k] = turns != 0
                twice += turns > 1 or turns < 0
    return twice


@njit(**KERNEL)
def vote_by_parity(marks: Array, votes: Array) -> None:
    """Adds a vote where the crossings passed are odd; a ray with an odd total has no vote."""
    for i in range(marks.shape[0]):
        for j in range(marks.shape[1]):
            total = 0
            for k in range(marks.shape[2]):
                total += abs(marks[i, j, k])
            if total % 2:
                continue
            passed = 0
            for k in range(marks.shape[2]):
                passed += abs(marks[i, j, k])
                votes[i, j, k] += passed % 2


@njit(**KERNEL)
def window_sums(parts: Array, size: int) -> Array:
    """Return (X−s+1, Y−s+1, Z−s+1) int32 sums of the parts in each cube of s³ of them.

    A full cell of 32 samples a side holds 32768 of them, one more than int16 does.
    """
    n_x, n_y, n_z = parts.shape
    along_z = np.zeros((n_x, n_y, n_z - size + 1), dtype=np.int32)
    for i in range(n_x):
        for j in range(n_y):
            total = 0
            for k in range(n_z):
                total += parts[i, j, k]
                if k >= size:
                    total -= parts[i, j, k - size]
                if k >= size - 1:
                    along_z[i, j, k - size + 1] = total
    along_y = np.zeros((n_x, n_y - size + 1, along_z.shape[2]), dtype=np.int32)
    for i in range(n_x):
        for j in range(along_y.shape[1]):
            for s in range(size):
                for k in range(along_y.shape[2]):
                    along_y[i, j, k] += along_z[i, j + s, k]
    sums = np.zeros((n_x - size + 1, along_y.shape[1], along_y.shape[2]), dtype=np.int32)
    for i in range(sums.shape[0]):
        for s in range(size):
            for j in range(sums.shape[1]):
                for k in range(sums.shape[2]):
                    sums[i, j, k] += along_y[i + s, j, k]
    return sums


@njit(**KERNEL)
def window_histograms(sums: Array, size: int, full: int, levels: int) -> tuple[Array, Array]:
    """Two (s, s, s, levels + 1): for each offset how many windows are how full, and their sums.

    Args:
        sums: (X, Y, Z) of windows of ``size`` parts along each axis.
        size: Offsets along each axis.
        full: What the sum of a full window is.
        levels: Into how many steps fullness is told apart.
    """
    windows = np.zeros((size, size, size, levels + 1), dtype=np.int64)
    samples = np.zeros((size, size, size, levels + 1), dtype=np.int64)
    for i in range(sums.shape[0]):
        for j in range(sums.shape[1]):
            for k in range(sums.shape[2]):
                if sums[i, j, k]:
                    level = sums[i, j, k] * levels // full
                    windows[i % size, j % size, k % size, level] += 1
                    samples[i % size, j % size, k % size, level] += sums[i, j, k]
    return windows, samples
