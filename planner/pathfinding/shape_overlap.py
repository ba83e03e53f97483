"""Shape overlap: intersection over union of a solid with the modules that stand for it."""

from __future__ import annotations

from typing import Final

import numpy as np

from planner.chain.honeycomb import tetrahedra_at
from planner.errors import checked_fraction
from planner.pathfinding.filling_methods import FilledShape
from planner.shapes.solid import Solid
from planner.shapes.solid_sampling import sample
from planner.shapes.voxelise import Voxels

OVERLAP_POINTS: Final = 60_000
"""Number of random points by which the overlap (IoU) of a folded shape with the solid is estimated.
Larger values are more exact, more slowly: with this one the error is about 0.01. Chosen."""
OVERLAP_CELL_SAMPLES: Final = 6
"""Number of samples of the solid along each side of a cell, to measure the overlap of a folded
shape with the solid. Larger values are more exact, at cubic cost. Chosen."""


def intersection_over_union(solid: Solid, voxels: Voxels, filled: FilledShape) -> float:
    """Compute the intersection over union of the folded modules with the solid.

    Modules that fill their cells keep what the voxels keep; for others it is estimated from points
    spread evenly at random, to about a hundredth.
    """
    chain = filled.chains[0]
    if chain.module.fills_cell:
        return voxels.iou
    centres = filled.line[:-1] + filled.line[1:]
    low, high = 0.5 * centres.min(axis=0) - 1.5, 0.5 * centres.max(axis=0) + 1.5
    sampling = sample(
        solid, pitch=voxels.pitch, size=OVERLAP_CELL_SAMPLES, rotation=voxels.rotation
    )
    corners = np.argwhere(sampling.inside)

    # From samples to the turned solid, to cells, to the chain's space.
    def placed(samples: np.ndarray) -> np.ndarray:
        turned = (samples - sampling.offset) * (voxels.pitch / sampling.size)
        return filled.scale * (turned / voxels.pitch + voxels.offset) + filled.shift

    ends = placed(np.stack([corners.min(axis=0), corners.max(axis=0) + 1.0]))
    low, high = np.minimum(low, ends[0]), np.maximum(high, ends[1])
    points = np.random.default_rng(0).uniform(low, high, (OVERLAP_POINTS, 3))
    cells = (points - filled.shift) / filled.scale - voxels.offset
    at = np.floor(cells * sampling.size + sampling.offset).astype(np.int64)
    there = ((at >= 0) & (at < sampling.inside.shape)).all(axis=1)
    in_solid = np.zeros(len(points), dtype=bool)
    in_solid[there] = sampling.inside[tuple(at[there].T)]
    keys = np.concatenate([centres.astype(np.int64), tetrahedra_at(points)])
    _, inverse = np.unique(keys, axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    in_chain = np.isin(inverse[len(centres) :], inverse[: len(centres)])
    shared, union = (int(np.count_nonzero(a)) for a in (in_solid & in_chain, in_solid | in_chain))
    return checked_fraction(shared / max(1, union), "intersection over union")
