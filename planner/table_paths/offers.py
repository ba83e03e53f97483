"""Offers: checked changes of shapes without a path for a table that give them one."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

from foldback.planner.pathfinding import Cell
from foldback.planner.pathfinding.fill_cubes import BLOCK_CELLS, doubled
from foldback.planner.pathfinding.path_options import (
    DEFAULT_MODULES,
    MAX_TABLE_MODULES,
    MODULE_COUNTS,
    PathOptions,
)
from foldback.planner.shapes.shape import Shape
from foldback.planner.shapes.solid import Solid
from foldback.planner.shapes.voxelise import voxelise
from foldback.planner.table_paths.base_sides import sides_of
from foldback.planner.table_paths.mending import cells_to_add
from foldback.planner.table_paths.no_table_path_proofs import ruled_out
from foldback.planner.table_paths.table_paths import paths_or_reasons

Kind = Literal["repair", "modules", "blocks"]

MAX_BLOCK_COUNTS: Final = 9
"""Maximum number of different numbers of 2×2×2 blocks that are tried to find a variant that can
fold on a table."""
OFFER_DEFAULTS: Final[dict[str, Any]] = {"method": "auto", "repair": False}
"""Options of a request that every offered variant with another number of modules resets: the path
method is chosen automatically, and the shape is not repaired."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Offer:
    """A change for which a path was found that rests on a table at every step.

    Attributes:
        kind: ``repair`` adds cells, ``modules`` takes another count, ``blocks`` makes 2×2×2
            modules of each cell.
        modules: Number of modules of the chain.
        change: Options that differ from those asked for.
        added: Cells that a repair adds.
    """

    kind: Kind
    modules: int
    change: dict[str, Any]
    added: tuple[Cell, ...] = ()

    def report(self) -> dict[str, Any]:
        """Return plain JSON values."""
        return {
            "kind": self.kind,
            "modules": self.modules,
            "change": self.change,
            "added": [list(cell) for cell in self.added],
        }

    def options(self, requested: PathOptions) -> PathOptions:
        """Return the options of a fold that takes this offer."""
        return replace(requested, **self.change)


def table_offers(
    subject: Solid | Shape,
    options: PathOptions,
    *,
    seed: int = 0,
    time_limit_s: float = 20.0,
    cancelled: Callable[[], bool] = lambda: False,
) -> Iterator[Offer]:
    """Search for changes with which a chain can fold on a table.

    Of a solid, 2×2×2 modules come first, since they are found soonest; then a repair, then the
    nearest counts, none above ``MAX_TABLE_MODULES``. Of cells, a repair comes first.

    Args:
        subject: Input solid or shape.
        options: Requested options.
        seed: Seed of the searches; a fold with the same seed finds the same paths.
        time_limit_s: Wall time, s. It is checked between shapes, each of which takes a second.
        cancelled: Returns True to end the search; called between shapes.
    """
    deadline = time.monotonic() + time_limit_s

    def over() -> bool:
        return cancelled() or time.monotonic() > deadline

    if isinstance(subject, Shape):
        yield from _of_cells(subject, options, seed, over)
    else:
        yield from _of_solid(subject, options, seed, over)


def _of_cells(
    shape: Shape, options: PathOptions, seed: int, over: Callable[[], bool]
) -> Iterator[Offer]:
    if over():
        return
    if not options.repair and (added := cells_to_add(shape.cells, seed)):
        yield _repair(shape, added)
    count = BLOCK_CELLS * len(shape)
    if options.method == "blocks" or count > MAX_TABLE_MODULES or over():
        return
    if _has_path(doubled(shape), seed, turned=True):
        yield Offer(kind="blocks", modules=count, change={"method": "blocks"})


def _of_solid(
    solid: Solid, options: PathOptions, seed: int, over: Callable[[], bool]
) -> Iterator[Offer]:
    requested_modules = DEFAULT_MODULES if options.modules is None else options.modules
    target = min(requested_modules, MAX_TABLE_MODULES)
    yield from _blocks(solid, target, seed, over)
    if over():
        return
    if target == requested_modules and not options.repair:
        shape = voxelise(solid, cells=requested_modules, seed=seed).shape
        added = cells_to_add(shape.cells, seed)
        if added and len(shape) + len(added) <= MAX_TABLE_MODULES:
            yield replace(_repair(shape, added), change={"method": "auto", "repair": True})
    for count in _counts(solid, target, seed, over):
        if count != requested_modules:
            yield Offer(kind="modules", modules=count, change={**OFFER_DEFAULTS, "modules": count})


def _blocks(solid: Solid, target: int, seed: int, over: Callable[[], bool]) -> Iterator[Offer]:
    """Yield the 2×2×2 modules closest to a count of modules that have a path."""
    middle = round(target / BLOCK_CELLS)
    steps = range(1, MAX_BLOCK_COUNTS)
    tries = [middle, *(middle + k * sign for k in steps for sign in (-1, 1))]
    for cells in [cells for cells in tries if cells > 0][:MAX_BLOCK_COUNTS]:
        if over():
            return
        fine = doubled(voxelise(solid, cells=cells, seed=seed).shape)
        if len(fine) <= MAX_TABLE_MODULES and _has_path(fine, seed):
            change = {**OFFER_DEFAULTS, "method": "blocks", "modules": BLOCK_CELLS * cells}
            yield Offer(kind="blocks", modules=len(fine), change=change)
            return


def _counts(solid: Solid, target: int, seed: int, over: Callable[[], bool]) -> Iterator[int]:
    """Yield the nearest smaller and the nearest larger count with a path, as they are found.

    The count itself is the smaller one if it has a path.
    """
    first = voxelise(solid, cells=target, seed=seed)
    following = {"below": target, "above": first.above}
    low, high = MODULE_COUNTS[0], MAX_TABLE_MODULES
    for _ in range(12):
        for side, count in list(following.items()):
            if over():
                return
            if count is None or not low <= count <= high:
                del following[side]
                continue
            voxels = voxelise(solid, cells=count, seed=seed)
            if len(voxels.shape) == count and _has_path(voxels.shape, seed):
                yield count
                del following[side]
            else:
                following[side] = voxels.below if side == "below" else voxels.above


def _has_path(shape: Shape, seed: int, *, turned: bool = False) -> bool:
    sides = list(sides_of(shape.cells, turned=turned))
    reasons = [ruled_out(side) for side in sides]
    if all(reason is not None and not reason.may_fall for reason in reasons):
        return False
    return bool(paths_or_reasons(shape.cells, seed=seed, max_paths=1, turned=turned)[0])


def _repair(shape: Shape, added: list[Cell]) -> Offer:
    return Offer(
        kind="repair",
        modules=len(shape) + len(added),
        change={"repair": True},
        added=tuple(added),
    )
