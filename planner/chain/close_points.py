"""Close points: a test of one configuration for modules that lie in one another."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array


def first_close_pair(points: Array, closest: float) -> tuple[int, int] | None:
    """Two points closer to each other than ``closest``, or None.

    Args:
        points: (n, 3).
        closest: Distance that all pairs should keep.

    Returns:
        Indices i < j; of the pairs found, the one with the smallest j.
    """
    # In bins of this size any two points are too close, so an empty answer leaves one a bin.
    bins = np.floor((points - points.min(axis=0)) * (np.sqrt(3.0) / closest)).astype(np.int64) + 2
    spans = bins.max(axis=0) + 3
    strides = np.array([spans[1] * spans[2], spans[2], 1])
    keys: NDArray[Any] = bins @ strides
    order = np.argsort(keys, kind="stable")
    ranked = keys[order]
    twice = np.flatnonzero(ranked[1:] == ranked[:-1])
    pairs = [np.column_stack([order[twice], order[twice + 1]])]
    for offset in product(range(-2, 3), repeat=3):
        shift = int(np.dot(offset, strides))
        if shift <= 0:
            continue
        place = np.minimum(np.searchsorted(ranked, keys + shift), len(keys) - 1)
        near = np.flatnonzero(ranked[place] == keys + shift)
        pairs.append(np.column_stack([near, order[place[near]]]))
    pairs_found = np.concatenate(pairs)
    gaps = np.linalg.norm(points[pairs_found[:, 0]] - points[pairs_found[:, 1]], axis=1)
    pairs_found = np.sort(pairs_found[gaps < closest], axis=1)
    if not len(pairs_found):
        return None
    i, j = pairs_found[np.lexsort((pairs_found[:, 0], pairs_found[:, 1]))[0]].tolist()
    return i, j
