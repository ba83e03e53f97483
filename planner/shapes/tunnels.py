"""Tunnels: holes that go through a shape, such as that of a ring or of a mug's handle."""

from __future__ import annotations

from typing import Any

import numpy as np

from foldback.planner.arrays import Flags, Ints
from foldback.planner.shapes.bridges import parts_of


def tunnels_of_cells(cells: Flags) -> int:
    """Return the number of tunnels of cells of which only those that share a face are connected.

    It is the first Betti number, from Euler's formula: parts − tunnels + cavities.

    Args:
        cells: (X, Y, Z) True for the cells.
    """
    from scipy import ndimage  # not before a mesh is read: importing it takes a while

    padded = np.pad(cells, 1)
    label: Any = ndimage.label
    _, spaces = label(~padded, structure=np.ones((3, 3, 3)))
    parts = len(parts_of(padded)[1])
    return parts + (int(spaces) - 1) - _euler_characteristic(padded)


def tunnels_of_samples(inside: Flags) -> int | None:
    """Return the number of tunnels of a sampled solid; None if the samples are too coarse to tell.

    They tell if the number is the same whether samples that only share an edge or a corner count
    as connected or not.

    Args:
        inside: (X, Y, Z) True for samples inside.
    """
    tunnels = tunnels_of_cells(inside)
    # A set and its complement have the same number of tunnels.
    return tunnels if tunnels == tunnels_of_cells(~np.pad(inside, 1)) else None


def tunnels_of_surface(faces: Ints) -> int | None:
    """Return the number of tunnels of the solid within closed surfaces.

    Args:
        faces: (F, 3) triangles of surfaces that neither cross nor touch.

    Returns:
        The sum of the surfaces' genera; None if more than two triangles share an edge.
    """
    from scipy import sparse  # not before a mesh is read: importing it takes a while

    used, corners = np.unique(faces, return_inverse=True)
    corners = corners.reshape(-1, 3)
    runs = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges, shared = np.unique(runs[:, 0] * len(used) + runs[:, 1], return_counts=True)
    if (shared != 2).any():
        return None
    links: Any = sparse.coo_matrix(
        (np.ones(len(edges), dtype=np.bool_), np.divmod(edges, len(used))),
        shape=(len(used), len(used)),
    )
    connected: Any = sparse.csgraph.connected_components
    surfaces = int(connected(links, directed=False)[0])
    euler = len(used) - len(edges) + len(faces)
    return surfaces - euler // 2 if euler % 2 == 0 else None


def _euler_characteristic(cells: Flags) -> int:
    """Return cells − shared faces + full 2×2 squares − full 2×2×2 blocks."""
    total = int(np.count_nonzero(cells))
    for axes in ((0,), (1,), (2,), (0, 1), (0, 2), (1, 2), (0, 1, 2)):
        full = cells
        for axis in axes:
            low = tuple(slice(None, -1) if k == axis else slice(None) for k in range(3))
            high = tuple(slice(1, None) if k == axis else slice(None) for k in range(3))
            full = full[low] & full[high]
        total += (-1) ** len(axes) * int(np.count_nonzero(full))
    return total
