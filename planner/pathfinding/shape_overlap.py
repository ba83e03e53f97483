"""Shape overlap: measures how much the modules of a folded chain and their input overlap."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Flags, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.honeycomb import tetrahedra_at
from foldback.planner.errors import checked_fraction
from foldback.planner.shapes.inside_points import InsidePoints
from foldback.planner.shapes.likeness import Likeness
from foldback.planner.shapes.shape import Shape
from foldback.planner.shapes.uncovered_surface import ModuleRegions

TETRAHEDRON_PLANES: Final = 0.5 * np.array(
    [[1, 1, 0], [1, -1, 0], [1, 0, 1], [1, 0, -1], [0, 1, 1], [0, 1, -1]]
)
"""(6, 3) normals of the faces of the honeycomb's tetrahedra; their planes are at integers."""
CELL_POINTS: Final = 60_000
"""Approximate number of points in all given cells together, if tetrahedra fill them."""


def likeness_of(placed: InsidePoints, modules: Chain | Ints) -> Likeness:
    """Return the likeness of modules to an input.

    Args:
        placed: Points of the whole input, in the space of the folded modules.
        modules: Folded chain; or (n, 3) cells, each filled by one cube around its position.
    """
    covered = covered_by(modules, placed.points)
    volume = len(modules) * (modules.module.volume if isinstance(modules, Chain) else 1.0)
    share = float(covered.mean()) if len(covered) else 0.0
    # Sampling errors must not make the overlap larger than the modules.
    overlap = min(share * placed.volume, volume)

    def fraction(value: float, name: str) -> float:
        return round(checked_fraction(value, name), 4)

    return Likeness(
        iou=fraction(overlap / (placed.volume + volume - overlap), "intersection over union"),
        missing=fraction(1.0 - share, "missing share"),
        added=fraction(1.0 - overlap / volume, "added share"),
    )


def covered_by(modules: Chain | Ints, points: Array) -> Flags:
    """(P,) True for points in modules; see ``likeness_of``."""
    if not isinstance(modules, Chain):
        return _among(np.floor(points + 0.5).astype(np.int64), modules)
    positions = modules.folded_poses.positions
    if modules.module.filling == "rings":
        # A tetrahedron is named by the sum of its two nodes, twice its middle.
        return _among(tetrahedra_at(points), np.rint(2.0 * positions).astype(np.int64))
    return covered_by(np.rint(positions).astype(np.int64), points)


def regions_of(modules: Chain | Ints) -> ModuleRegions:
    """Return modules as a region of space; see ``likeness_of``."""
    is_covered = partial(covered_by, modules)
    if isinstance(modules, Chain) and modules.module.filling == "rings":
        return ModuleRegions(is_covered=is_covered, normals=TETRAHEDRON_PLANES, offset=0.0)
    return ModuleRegions(is_covered=is_covered, normals=np.eye(3), offset=0.5)


def _among(rows: Ints, members: Ints) -> Flags:
    """(P,) True for (P, 3) rows that are among (n, 3) wanted ones."""
    low, high = members.min(axis=0), members.max(axis=0)
    near = ((rows >= low) & (rows <= high)).all(axis=1)
    sizes = high - low + 1
    keys, member_keys = (
        np.ravel_multi_index(tuple((cells - low).T), tuple(sizes))
        for cells in (rows[near], members)
    )
    near[near] = np.isin(keys, member_keys)
    return near


def points_of_cells(shape: Shape, *, exact: bool) -> InsidePoints:
    """Spread points evenly in the cells of a shape; cell c reaches from c to c + 1.

    Args:
        shape: The cells.
        exact: True if cubes stand for the cells or for eighths of them, for which two points along
            each edge are exact.
    """
    low_samples, high_samples = 2, 8  # two represent cells and eighths of cells exactly
    edge = (
        low_samples
        if exact
        else int(np.clip(np.cbrt(CELL_POINTS / len(shape)), low_samples, high_samples))
    )
    grid = (np.stack(np.meshgrid(*[np.arange(edge)] * 3, indexing="ij"), axis=-1) + 0.5) / edge
    points = (shape.cells[:, None, :] + grid.reshape(1, -1, 3)).reshape(-1, 3)
    return InsidePoints(points=points, volume=float(len(shape)))
