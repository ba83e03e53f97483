"""Different shapes: a selection from the gallery that is as varied as possible."""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench.shape_files import SHAPES
from foldback.planner.chain.path import Path
from foldback.planner.readers import read

Array = NDArray[np.float64]
CHOSEN_SHAPES: Final = 10
"""Number of the gallery's shapes, as different from each other as possible, that are folded with
the published method in addition to those of the paper."""
MODULE_RANGE: Final = (64, 200)
"""Least and largest number of modules of a shape that may be chosen."""
EXCLUDED_PREFIXES: Final = ("wrench", "mallet")
"""Beginnings of the names of the paper's own shapes, which are not chosen."""


@cache
def different_shapes() -> tuple[str, ...]:
    """Return the names of ``CHOSEN_SHAPES`` shapes of cubes that differ as much as possible.

    The first one is the farthest from the mean of all, each further one the farthest from those
    before it. Distances are those of ``features``, each divided by its standard deviation.
    """
    names, rows = measured()
    scaled = (rows - rows.mean(axis=0)) / rows.std(axis=0)
    order = [int(np.linalg.norm(scaled, axis=1).argmax())]
    nearest = np.full(len(names), np.inf)
    while len(order) < CHOSEN_SHAPES:
        distance = np.linalg.norm(scaled - scaled[order[-1]], axis=1)
        nearest = np.minimum(nearest, distance)
        order.append(int(nearest.argmax()))
    return tuple(names[k] for k in order)


def features(cells: NDArray[np.int64]) -> Array:
    """Return six features of a path.

    They are the logarithm of its length, the sides of its box divided by length^⅓ (short to long),
    its compactness (fraction of the box that is filled), and the turns for each inner module.
    """
    n = len(cells)
    sides = np.sort(np.ptp(cells, axis=0) + 1).astype(np.float64)
    steps = np.diff(cells, axis=0)
    turns = float((steps[1:] != steps[:-1]).any(axis=1).mean())
    return np.array([np.log(n), *(sides / np.cbrt(n)), n / sides.prod(), turns])


def measured() -> tuple[list[str], Array]:
    """Return the names and (S, 6) features of all shapes that may be chosen."""
    names: list[str] = []
    rows: list[Array] = []
    for file in sorted(SHAPES.glob("*.json")):
        if file.stem.startswith(EXCLUDED_PREFIXES):
            continue
        result = read(file.read_bytes(), filename=file.name)
        if isinstance(result, Path) and MODULE_RANGE[0] <= len(result.cells) <= MODULE_RANGE[1]:
            names.append(file.stem)
            rows.append(features(np.asarray(result.cells, dtype=np.int64)))
    return names, np.array(rows)
