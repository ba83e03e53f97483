"""Decimation: fewer triangles for looking at a mesh, by merging vertices that lie close."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array

Faces = NDArray[np.int64]


def decimated(vertices: Array, faces: Faces, *, max_faces: int) -> tuple[Array, Faces]:
    """Return a similar mesh of at most ``max_faces`` triangles.

    Vertices in one cell of a grid become one, in their middle; triangles that vanish are left out.
    The grid is made coarser until few enough are left.

    Args:
        vertices: (V, 3) points.
        faces: (F, 3) indices.
        max_faces: Maximum number of triangles.
    """
    if len(faces) <= max_faces:
        return vertices, faces
    low = vertices.min(axis=0)
    size = float((vertices.max(axis=0) - low).max())
    cells = max(4.0, 2.0 * np.sqrt(max_faces / 4.0))
    for _ in range(40):  # at last the grid is 7500 times coarser, and no triangle remains
        fewer = _merged(vertices, faces, low, size / cells if size > 0 else 1.0)
        if len(fewer[1]) <= max_faces:
            return fewer
        cells /= 1.25
    return vertices[:0], faces[:0]


def _merged(vertices: Array, faces: Faces, low: Array, grid: float) -> tuple[Array, Faces]:
    places = np.floor((vertices - low) / grid).astype(np.int64)
    _, first, of = np.unique(places, axis=0, return_index=True, return_inverse=True)
    of = of.reshape(-1)
    counts = np.bincount(of, minlength=len(first)).astype(np.float64)
    middles = np.column_stack(
        [np.bincount(of, weights=vertices[:, k], minlength=len(first)) / counts for k in range(3)]
    )
    mapped = of[faces]
    a, b, c = mapped.T
    proper = mapped[(a != b) & (b != c) & (c != a)]
    _, index = np.unique(np.sort(proper, axis=1), axis=0, return_index=True)
    return middles, proper[np.sort(index)]
