"""Filling of a solid with cubes whose cells are chosen together with the path through them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from hashlib import sha256
from typing import Final

import numpy as np

from foldback.planner.arrays import Flags, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.core import grow
from foldback.planner.errors import InputError
from foldback.planner.path_fit.fit import FittedPath, PathFit, fit_path
from foldback.planner.path_fit.fit_table import MAX_TABLE_FITTED_MODULES, SIDES, fit_on_table
from foldback.planner.path_fit.placements import Placement
from foldback.planner.pathfinding.filled_shape import FilledShape
from foldback.planner.pathfinding.knots import knot_of
from foldback.planner.pathfinding.lattice import index_of, neighbours, surface
from foldback.planner.pathfinding.path_options import DEFAULT_MODULES, PathOptions
from foldback.planner.pathfinding.path_reasons import PathCode, PathReason
from foldback.planner.shapes.lattice_fits import Ladder
from foldback.planner.shapes.orientations import candidates
from foldback.planner.shapes.separate_bodies import joined_note
from foldback.planner.shapes.shape import Shape
from foldback.planner.shapes.solid import Solid
from foldback.planner.shapes.voxelise import LaidCells, Voxels, measure_retention, voxels_of
from foldback.planner.table_paths.base_sides import SIDE_NAMES

METHOD: Final = "fitted"
MAX_FITTED_MODULES: Final = 2_000
"""Maximum number of modules of a fitted path: annealing longer ones takes too long."""
MIN_FITTED_MODULES: Final = 8
REROUTES: Final = 8
"""Number of searches for a path through fitted cells with other ends."""


def fill_fitted(
    solid: Solid, options: PathOptions, *, seed: int, quick: bool = False
) -> tuple[Voxels, FilledShape]:
    """Fit a path to a solid.

    Args:
        solid: The solid.
        options: Number of modules, ends and start of the chain.
        seed: Random seed.
        quick: True for the first result; False for the best.

    Returns:
        The cells of the path, and the chains; all of them lie in the same lattice.

    Raises:
        InputError: ``wrong-count`` for more modules than can be fitted; ``no-path`` if no path was
            found with exactly the requested number; ``not-a-cell`` for a start that is no cell of
            the path.
    """
    modules = DEFAULT_MODULES if options.modules is None else options.modules
    if modules > MAX_FITTED_MODULES:
        raise InputError(
            "wrong-count",
            f"got {modules} modules with the method '{METHOD}', expected at most "
            f"{MAX_FITTED_MODULES}; use fewer modules or the method 'blocks'.",
        )
    exact = options.method == "exact"
    ladder, fit = _fit(solid, modules, seed, exact=exact, quick=quick)
    if exact:
        check_exact(len(fit.paths[0].cells), modules)
    voxels = _voxels(ladder, fit.paths[0], modules)
    orders = _orders(fit.paths)
    routed, not_started = _with_ends(orders[0], options, seed)
    orders = [routed] if routed is not None else orders
    return voxels, _filled(voxels, orders, not_started=not_started)


def fill_for_table(
    solid: Solid, options: PathOptions, *, seed: int
) -> tuple[Voxels, FilledShape] | None:
    """Fit a path for a table to a solid.

    Args:
        solid: The solid, of which the last axis points up.
        options: Number of modules.
        seed: Random seed.

    Returns:
        The cells of the path, and the chains, the one that should fold most easily first; all of
        them lie in the same lattice. None for more than ``MAX_TABLE_FITTED_MODULES`` modules, or
        if no path for a table was found.
    """
    modules = DEFAULT_MODULES if options.modules is None else options.modules
    if modules > MAX_TABLE_FITTED_MODULES:
        return None
    ladder = Ladder(solid, SIDES)
    fits = fit_on_table(ladder, modules, seed=seed)
    if not fits:
        return None
    down = fits[0].down
    notes = () if down == "-z" else (f"The shape lies on its {SIDE_NAMES[down]} side.",)
    paths = tuple(fit.fitted for fit in fits)
    voxels = _voxels(ladder, paths[0], modules)
    return voxels, _filled(voxels, _orders(paths), notes=notes)


def check_exact(count: int, modules: int) -> None:
    """Refuse a path of another number of cells than was asked for.

    Raises:
        InputError: ``no-path``.
    """
    if count != modules:
        raise InputError(
            "no-path",
            f"got a path of {count} cells, expected one of exactly {modules}. Ask for {count} "
            "modules, or use the method 'auto', which may use fewer.",
        )


def _orders(paths: tuple[FittedPath, ...]) -> list[Ints]:
    """Return the cells of paths in one placement, from the lowest corner of the first one."""
    low = paths[0].cells.min(axis=0)
    return [fitted.cells - low for fitted in paths]


def _filled(
    voxels: Voxels,
    orders: list[Ints],
    *,
    notes: tuple[str, ...] = (),
    not_started: tuple[PathReason, ...] = (),
) -> FilledShape:
    """Return the chains along paths of one lattice, the best first."""
    name, pitch_m = voxels.shape.name, voxels.shape.pitch_m
    return FilledShape(
        chains=tuple(
            Chain.from_path(Path.from_cells(cells, name=name, pitch_m=pitch_m)) for cells in orders
        ),
        shape=Shape.from_cells(orders[0], name=name, pitch_m=pitch_m),
        method=METHOD,
        feasibility=None,
        cells=orders[0],
        line=orders[0].astype(np.float64),
        knot=knot_of(orders[0]),
        notes=notes,
        not_started=not_started,
        scale=1.0,
        shift=-0.5,
        modules_per_cell=1,
    )


_LaidFit = tuple[Ladder, PathFit]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _StartedFit:
    """A fit with a first result.

    Attributes:
        key: Digest of the solid and of all that the fit depends on.
        first: The first result, and the solid with its orientations.
        later: Computes the later results.
    """

    key: bytes
    first: _LaidFit
    later: Iterator[_LaidFit]


_started: list[_StartedFit] = []
"""The last fit of this process of which only the first result was computed, if any. Clients mostly
request its final result next, which then takes less time and is the same."""


def _fit(solid: Solid, modules: int, seed: int, *, exact: bool, quick: bool) -> _LaidFit:
    """Return the first or the final result of a fit."""
    key = _key(solid, modules, seed, exact=exact)
    fit = _started.pop() if _started else None
    if fit is None or fit.key != key:
        later = _stages(solid, modules, seed, exact=exact)
        fit = _StartedFit(key=key, first=next(later), later=later)
    if quick:
        _started.append(fit)
        return fit.first
    return list(fit.later)[-1]


def _stages(solid: Solid, modules: int, seed: int, *, exact: bool) -> Iterator[_LaidFit]:
    """Yield the results of a fit; of separate bodies all, if joining them pays, or the largest."""
    turns = candidates(solid, np.random.default_rng(seed))
    ladder = Ladder(solid, turns)
    ladders = [ladder] if ladder.share == 1.0 else [ladder, Ladder(solid, turns, all_bodies=True)]
    fits = [fit_path(candidate, modules, seed=seed, exact=exact) for candidate in ladders]
    for stage in zip(*fits, strict=True):
        yield max(zip(ladders, stage, strict=True), key=_worth)


def _worth(laid: _LaidFit) -> float:
    """Return the IoU with the whole solid, less what joined bodies must gain."""
    ladder, fit = laid
    # IoU for which modules in the air join bodies
    return _path_iou(ladder, fit.paths[0]) - (0.03 if ladder.all_bodies else 0.0)


def _path_iou(ladder: Ladder, fitted: FittedPath) -> float:
    """Return the IoU of a path with the whole solid."""
    return whole_iou(ladder, fitted.placement, len(fitted.cells), fitted.iou)


def whole_iou(ladder: Ladder, placement: Placement, count: int, iou: float) -> float:
    """Return the IoU of ``count`` modules with the whole solid, from that with the used body."""
    volume = placement.volume
    shared = iou * (volume + count) / (1.0 + iou)
    return shared / (volume / ladder.share + count - shared)


def _key(solid: Solid, modules: int, seed: int, *, exact: bool) -> bytes:
    of_solid = (solid.closed, solid.oriented, solid.surfaces)
    digest = sha256(repr((modules, seed, exact, *of_solid)).encode())
    digest.update(solid.vertices.tobytes())
    digest.update(solid.faces.tobytes())
    return digest.digest()


def _voxels(ladder: Ladder, fitted: FittedPath, modules: int) -> Voxels:
    """Return the cells of a path as voxels."""
    place = fitted.placement
    cells: Flags = np.zeros(place.fill.shape, dtype=np.bool_)
    cells[tuple(fitted.cells.T)] = True
    filled = np.maximum(place.fill, 0).astype(np.float64)
    laid = LaidCells(
        cells=cells, pitch=place.pitch, rotation=place.turn.rotation, offset=place.offset
    )
    retention = measure_retention(ladder, cells, filled, _path_iou(ladder, fitted))
    voxels = voxels_of(ladder, laid, retention, fitted.iou, requested_cells=modules)
    if ladder.all_bodies and not voxels.unused:
        notes = (joined_note(len(ladder.bodies)), *voxels.notes)
        voxels = replace(voxels, notes=notes, joined=True)
    return voxels


def _with_ends(
    cells: Ints, options: PathOptions, seed: int
) -> tuple[Ints | None, tuple[PathReason, ...]]:
    """Return a path through the same cells with the requested ends; None if that is not needed.

    Returns:
        The path, and the reasons why none has the requested ends; none if one has.
    """
    start = index_of(cells, options.start)
    ends: Flags = np.ones(len(cells), dtype=np.bool_)
    if options.ends == "surface":
        ends = surface(cells)
    for order in (cells, cells[::-1]):
        at_start = start is None or tuple(order[0].tolist()) == options.start
        if at_start and ends[[0, -1]].all():
            return (None if order is cells else np.ascontiguousarray(order)), ()
    near = neighbours(cells)
    for attempt in range(REROUTES):
        length, path = grow(
            near,
            ends,
            -1 if start is None else start,
            400 * len(cells),
            REROUTES * seed + attempt,
        )
        if length == len(cells):
            return cells[path], ()
    if options.start is None:
        return None, (PathReason.of(PathCode.NO_SURFACE_ENDS),)
    return None, (PathReason.of(PathCode.NOT_STARTED, cell=options.start),)
