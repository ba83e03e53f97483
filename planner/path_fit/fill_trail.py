"""Filling of a solid with tetrahedra that are chosen so that a closed trail leads through them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foldback.planner.arrays import Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.honeycomb import TETRAHEDRA_PER_RING, ring_of, rings_with
from foldback.planner.path_fit.fill_fitted import METHOD, whole_iou
from foldback.planner.path_fit.fit_trail import FittedTetrahedra, fit_trail
from foldback.planner.pathfinding.filled_shape import FilledShape
from foldback.planner.pathfinding.knots import knot_of
from foldback.planner.pathfinding.lattice import index_of
from foldback.planner.pathfinding.path_options import DEFAULT_MODULES, PathOptions
from foldback.planner.pathfinding.path_reasons import PathReason
from foldback.planner.pathfinding.trail_search import TrailSearch, trails_through
from foldback.planner.shapes.lattice_fits import Ladder
from foldback.planner.shapes.orientations import candidates
from foldback.planner.shapes.shape import Shape
from foldback.planner.shapes.solid import Solid
from foldback.planner.shapes.voxelise import (
    PART_LOST_SHARE,
    LaidCells,
    Retention,
    Voxels,
    voxels_of,
)


def fill_with_trail(solid: Solid, options: PathOptions, *, seed: int) -> tuple[Voxels, FilledShape]:
    """Fit a trail of tetrahedra to a solid.

    The rings of twelve that they are parts of stand for the cells.

    Args:
        solid: The solid.
        options: Number of modules, ends and start of the chain.
        seed: Random seed.

    Returns:
        The cells, and the chains.

    Raises:
        InputError: ``not-a-cell`` for a start that is no cell of the trail.
    """
    modules = DEFAULT_MODULES if options.modules is None else options.modules
    ladder = Ladder(solid, candidates(solid, np.random.default_rng(seed)))
    fitted = fit_trail(ladder, modules, seed=seed)
    pairs = fitted.pairs
    grid = np.argwhere(np.ones(pairs.max(axis=(0, 1)) // 2 + 1, dtype=np.bool_))
    rings = grid[rings_with(pairs.sum(axis=1), grid)]
    voxels = _voxels(ladder, fitted, rings, modules)
    search, not_started = _trails(voxels.shape, pairs - 2 * rings.min(axis=0), options, seed)
    trail = search.trails[0]
    return voxels, FilledShape(
        chains=tuple(Chain.from_trail(trail) for trail in search.trails),
        shape=voxels.shape,
        method=METHOD,
        feasibility=None,
        cells=voxels.shape.cells[ring_of(trail.nodes, voxels.shape.cells)],
        line=trail.nodes.astype(np.float64),
        knot=knot_of(trail.nodes),
        notes=(),
        not_started=not_started,
        scale=2.0,
        shift=1.0,
        modules_per_cell=TETRAHEDRA_PER_RING,
    )


def _trails(
    shape: Shape, pairs: Ints, options: PathOptions, seed: int
) -> tuple[TrailSearch, tuple[PathReason, ...]]:
    """Return trails, and the reasons why none has the requested ends; none if one has."""
    index = index_of(shape.cells, options.start)
    first = None if index is None else shape.cells[index]
    search = trails_through(shape, pairs, ends=options.ends, first=first, seed=seed)
    if search.trails:
        return search, ()
    return trails_through(shape, pairs, seed=seed), search.reasons


def _voxels(ladder: Ladder, fitted: FittedTetrahedra, rings: Ints, modules: int) -> Voxels:
    """Return the rings that the tetrahedra are parts of as voxels."""
    placement = fitted.placement
    cells = np.zeros(rings.max(axis=0) + 1, dtype=np.bool_)
    cells[tuple(rings.T)] = True
    laid = LaidCells(
        cells=cells,
        pitch=2.0 * placement.pitch,
        rotation=placement.turn.rotation,
        offset=0.5 * (placement.offset - 1.0),
    )
    retention = Retention(
        iou=whole_iou(ladder, placement, len(fitted.members), fitted.iou),
        volume=fitted.shared * ladder.share,
        lost=fitted.lost,
        tunnels=ladder.tunnels or 0,
        parts=fitted.lost <= PART_LOST_SHARE,
    )
    # Tunnels between tetrahedra are not counted.
    return replace(
        voxels_of(ladder, laid, retention, fitted.iou, requested_cells=modules), tunnels=None
    )
