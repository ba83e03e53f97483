"""Different shapes: some of the gallery that have least in common, chosen by what is measured."""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from examples.run_gallery import SHAPES
from planner.chain.path import Path
from planner.readers import read

Array = NDArray[np.float64]
CHOSEN: Final = 10
MODULES: Final = (64, 200)
ASIDE: Final = ("wrench", "mallet")
"""Begin the names of the paper's own shapes."""


@cache
def different_shapes() -> tuple[str, ...]:
    """Names of ``CHOSEN`` shapes of cubes: each is the farthest from those chosen before it.

    The first is the farthest from the mean of all. Distances are those of ``features``, each
    divided by its standard deviation.
    """
    names, rows = measured()
    scaled = (rows - rows.mean(axis=0)) / rows.std(axis=0)
    order = [int(np.linalg.norm(scaled, axis=1).argmax())]
    nearest = np.full(len(names), np.inf)
    while len(order) < CHOSEN:
        away = np.linalg.norm(scaled - scaled[order[-1]], axis=1)
        nearest = np.minimum(nearest, away)
        order.append(int(nearest.argmax()))
    return tuple(names[k] for k in order)


def features(cells: NDArray[np.int64]) -> Array:
    """(6,) of a path: log of its length, sides of its box by length^⅓ (short to long), compactness
    (share of its box that is filled), and turns for each inner module.
    """
    n = len(cells)
    sides = np.sort(np.ptp(cells, axis=0) + 1).astype(np.float64)
    steps = np.diff(cells, axis=0)
    turns = float((steps[1:] != steps[:-1]).any(axis=1).mean())
    return np.array([np.log(n), *(sides / np.cbrt(n)), n / sides.prod(), turns])


def measured() -> tuple[list[str], Array]:
    """Names and (S, 6) features of all that may be chosen."""
    names: list[str] = []
    rows: list[Array] = []
    for file in sorted(SHAPES.glob("*.json")):
        if file.stem.startswith(ASIDE):
            continue
        found = read(file.read_bytes(), filename=file.name)
        if isinstance(found, Path) and MODULES[0] <= len(found.cells) <= MODULES[1]:
            names.append(file.stem)
            rows.append(features(np.asarray(found.cells, dtype=np.int64)))
    return names, np.array(rows)
