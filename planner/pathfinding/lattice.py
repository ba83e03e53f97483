"""Adjacency of cells on the cubic lattice, and the spread of touching cells along a path."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from foldback.planner.arrays import Array, Flags, Ints
from foldback.planner.chain.path import STEPS
from foldback.planner.errors import InputError
from foldback.planner.pathfinding import Cell

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def tuples(cells: Ints) -> tuple[Cell, ...]:
    """Return (n, 3) cells as tuples."""
    return tuple((x, y, z) for x, y, z in cells.tolist())


def keys_of(cells: Ints, low: Ints, size: Ints) -> Ints:
    """Return (n,) keys of the cells of a box, in lexicographic order."""
    x, y, z = np.moveaxis(cells - low, -1, 0)
    return (x * size[1] + y) * size[2] + z


def neighbours(cells: Ints) -> Ints:
    """Return (n, 6) indices of the neighbours in the order of ``STEPS``; −1 without one."""
    low = cells.min(axis=0) - 1
    size = cells.max(axis=0) - low + 2
    keys = keys_of(cells, low, size)
    order = np.argsort(keys)
    ranked = keys[order]
    indices = np.empty((len(cells), 6), dtype=np.int64)
    for k, step in enumerate(STEPS):
        neighbour_keys = keys_of(cells + np.array(step), low, size)
        place = np.minimum(np.searchsorted(ranked, neighbour_keys), len(cells) - 1)
        indices[:, k] = np.where(ranked[place] == neighbour_keys, order[place], -1)
    return indices


def index_of(cells: Ints, start: Cell | None) -> int | None:
    """Return the index of a cell; None for None.

    Raises:
        InputError: ``not-a-cell``: it is not among them.
    """
    if start is None:
        return None
    matches = np.flatnonzero((cells == np.array(start)).all(axis=1))
    if not len(matches):
        raise InputError("not-a-cell", f"got the start cell {start}, expected a cell of the shape.")
    return int(matches[0])


def contacts(cells: Ints) -> Ints:
    """Return (m, 2) pairs of cells that share a face, each pair once."""
    near = neighbours(cells)[:, ::2]
    first, side = np.nonzero(near >= 0)
    return np.stack([first, near[first, side]], axis=1).astype(np.int64)


def surface(cells: Ints) -> Flags:
    """Return (n,) flags: True for cells with a free face."""
    return np.asarray((neighbours(cells) < 0).any(axis=1))


def colours(cells: Ints) -> Ints:
    """Return (n,) 0 or 1, as on a chessboard: neighbours differ."""
    return cells.sum(axis=1) & 1


def graph(cells: Ints) -> csr_array:
    """Return the (n, n) adjacency matrix of the cells."""
    from scipy.sparse import csr_array  # late: reading a requested cell does without

    pairs = contacts(cells)
    both_directions = np.concatenate([pairs, pairs[:, ::-1]])
    weights = np.ones(len(both_directions), dtype=np.bool_)
    return csr_array(
        (weights, (both_directions[:, 0], both_directions[:, 1])), shape=(len(cells), len(cells))
    )


def parts(cells: Ints) -> tuple[int, Ints]:
    """Return the number of connected parts, and the (n,) part of each cell."""
    from scipy.sparse.csgraph import connected_components  # as above

    count, labels = connected_components(graph(cells), directed=False)
    return int(count), np.asarray(labels, dtype=np.int64)


def spread(order: Ints) -> float:
    """Return the mean distance of touching cells along a path; less is easier to unfold."""
    pairs = contacts(order)
    return float(np.abs(pairs[:, 0] - pairs[:, 1]).mean()) if len(pairs) else 0.0


def spreads_of_cuts(cycle: Ints) -> Array:
    """Return the (n,) spread of a closed cycle cut open before each of its cells."""
    n = len(cycle)
    pairs = contacts(cycle)
    low, high = pairs.min(axis=1), pairs.max(axis=1)
    gap = high - low
    # A cut between the two, before one of low + 1 … high, makes their distance n − gap.
    change = np.zeros(n + 1, dtype=np.int64)
    np.add.at(change, low + 1, n - 2 * gap)
    np.add.at(change, high + 1, 2 * gap - n)
    return (gap.sum() + np.cumsum(change[:n])) / len(pairs)
