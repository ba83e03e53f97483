"""Path search: several paths through one shape, the most promising one first."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import permutations
from typing import Any, Final, Literal, TypeAlias

import numpy as np

from foldback.planner.arrays import Ints
from foldback.planner.chain.module import LONG_CHAIN
from foldback.planner.chain.path import Path
from foldback.planner.errors import InputError
from foldback.planner.pathfinding import PATH_ENDS, PATH_METHODS, Cell
from foldback.planner.pathfinding.assembly import layered_snake, solid_paths
from foldback.planner.pathfinding.block_merging import aligned_blocks, block_cycle, cut, cut_costs
from foldback.planner.pathfinding.exact_search import exact_path
from foldback.planner.pathfinding.knots import knot_of
from foldback.planner.pathfinding.lattice import index_of, parts, spread, spreads_of_cuts, surface
from foldback.planner.pathfinding.loose_block_merging import loose_block_cycle
from foldback.planner.pathfinding.no_path_proofs import disconnected
from foldback.planner.pathfinding.path_reasons import PathCode, PathReason
from foldback.planner.pathfinding.removal_analysis import analyse_removal
from foldback.planner.pathfinding.snake import is_box, snake_path
from foldback.planner.shapes.shape import Shape

Ends: TypeAlias = Literal["any", "surface"]

ASSEMBLY: Final = "assembly"
PATHS_PER_CANDIDATE: Final = 4
"""Number of paths through a shape that are made for each one that the search returns (the best
ones)."""
MAX_KNOT_CELLS: Final = 10_000
"""Maximum number of cells or tetrahedra of a path that is tested for a knot, which would keep the
chain from unfolding."""
MAX_CHOICE_MODULES: Final = 20_000
"""Maximum number of cells or tetrahedra of a shape for which several paths are made, to choose the
best; larger shapes get one."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathSearch:
    """Paths through a shape.

    Attributes:
        paths: Paths, the best first; empty if none was found.
        method: Method that found them: ``assembly``, ``blocks``, ``exact`` or ``snake``.
        reasons: Reasons why there are no paths, or only few.
    """

    paths: tuple[Path, ...]
    method: str
    reasons: tuple[PathReason, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Options:
    ends: str
    start: Cell | None
    seed: int
    tries: int
    deadline: float


def find_paths(
    shape: Shape,
    *,
    method: str = "auto",
    ends: str = "any",
    start: Cell | None = None,
    seed: int = 0,
    candidates: int = 4,
    time_limit_s: float = 20.0,
) -> PathSearch:
    """Find paths that visit every cell once and rank them.

    Unknotted ones come first, then those with both ends on the surface, then those where cells that
    touch lie close along the path, which unfold in fewer steps.

    Args:
        shape: The shape.
        method: ``blocks`` (shapes of 2×2×2 blocks), ``snake`` (boxes), ``exact`` (any cells),
            ``assembly`` (boxes and shapes of blocks, in an order in which they can be peeled off),
            or ``auto``, which takes blocks or a snake where they work, and assembly for large
            shapes where it does.
        ends: ``surface`` when both ends must have a free face.
        start: The cell that the path begins with, None for any.
        seed: Seed of all random choices.
        candidates: Maximum number of paths.
        time_limit_s: Seconds for ``exact``, by the clock.

    Raises:
        InputError: An option is unknown, or the start is none of the cells.
    """
    if method not in (*PATH_METHODS, ASSEMBLY):
        raise InputError(
            "unknown-method",
            f"got the method {method!r}, expected one of: {', '.join(PATH_METHODS)}.",
        )
    if ends not in PATH_ENDS:
        raise InputError(
            "unknown-ends", f"got {ends!r} for the path's ends, expected 'any' or 'surface'."
        )
    index_of(shape.cells, start)
    options = _Options(
        ends=ends,
        start=start,
        seed=seed,
        tries=1 if len(shape) > MAX_CHOICE_MODULES else candidates * PATHS_PER_CANDIDATE,
        deadline=time.monotonic() + time_limit_s,
    )
    box, coarse = is_box(shape), aligned_blocks(shape.cells)
    if method == ASSEMBLY or (method == "auto" and len(shape) >= LONG_CHAIN):
        paths = list(_assembled(shape, options, coarse))
        if paths or method == ASSEMBLY:
            reason = PathReason.of(PathCode.NO_ASSEMBLY)
            return _search(shape, paths, candidates, ASSEMBLY, reason, order=_by_peeling)
    if method == "snake" or (method == "auto" and box):
        paths = list(_snakes(shape, options)) if box else []
        if paths or method == "snake":
            reason = PathReason.of(PathCode.SNAKE_START if box else PathCode.NO_BOX)
            return _search(shape, paths, candidates, "snake", reason)
    if method == "blocks" or (method == "auto" and len(shape) % 8 == 0):
        count, labels = parts(shape.cells)
        paths = list(_blocks(shape, options, coarse)) if count == 1 else []
        if paths or method == "blocks":
            reason = PathReason.of(PathCode.NO_BLOCKS)
            if count > 1:
                reason = disconnected(shape.cells, labels).reason
            return _search(shape, paths, candidates, "blocks", reason)
    return _exact(shape, options, candidates)


def _search(
    shape: Shape,
    cell_lists: list[Ints],
    candidates: int,
    method: str,
    reason: PathReason,
    *,
    order: Callable[[Ints], tuple[Any, ...]] | None = None,
) -> PathSearch:
    paths = tuple(
        Path.from_cells(cells, name=shape.name, pitch_m=shape.pitch_m)
        for cells in ranked(cell_lists, order)[:candidates]
    )
    return PathSearch(paths=paths, method=method, reasons=() if paths else (reason,))


def ranked(paths: list[Ints], order: Callable[[Ints], tuple[Any, ...]] | None = None) -> list[Ints]:
    """Return the different paths in a reproducible order, the most promising first."""
    different = list({cells.tobytes(): cells for cells in paths}.values())
    if len(different) < 2:
        return different
    return sorted(different, key=order or _rank)


def _by_peeling(cells: Ints) -> tuple[float, float, bytes]:
    return -analyse_removal(cells).score, spread(cells), cells.tobytes()


def _rank(cells: Ints) -> tuple[int, int, float, bytes]:
    knotted = 0
    if len(cells) <= MAX_KNOT_CELLS:
        knotted = ("unknot", "undecided", "knotted").index(knot_of(cells).verdict)
    buried = 2 - int(surface(cells)[[0, -1]].sum())
    return knotted, buried, spread(cells), cells.tobytes()


def _fits(cells: Ints, options: _Options) -> bool:
    if options.start is not None and tuple(cells[0].tolist()) != options.start:
        return False
    return options.ends == "any" or bool(surface(cells)[[0, -1]].all())


def _assembled(shape: Shape, options: _Options, coarse: tuple[Ints, Ints] | None) -> Iterator[Ints]:
    """Yield paths in assembly order, reversed if the start or the ends require it."""
    low = shape.cells.min(axis=0)
    candidates: Iterable[Ints] = ()
    if is_box(shape):
        x, y, z = (int(side) for side in shape.cells.max(axis=0) - low + 1)
        snake = layered_snake((x, y, z)) + low
        if options.start is not None:
            snake = _turned_to(snake, np.array(options.start), low, (x, y, z))
        candidates = (snake,)
    elif coarse is not None:
        rng = np.random.default_rng(options.seed)
        candidates = (cells + coarse[1] for cells in solid_paths(coarse[0], rng, 2))
    for cells in candidates:
        for path in (cells, np.ascontiguousarray(cells[::-1])):
            if _fits(path, options):
                yield path
                break


def _snakes(shape: Shape, options: _Options) -> Iterator[Ints]:
    low = shape.cells.min(axis=0)
    x, y, z = (int(side) for side in shape.cells.max(axis=0) - low + 1)
    for a, b, c in permutations((0, 1, 2)):
        path = snake_path((x, y, z), axes=(a, b, c)) + low
        if options.start is not None:
            path = _turned_to(path, np.array(options.start), low, (x, y, z))
        if _fits(path, options):
            yield path


def _turned_to(path: Ints, start: Ints, low: Ints, sides: tuple[int, int, int]) -> Ints:
    """Return the snake of a box, mirrored so that it begins in another corner."""
    mirrored = 2 * low + np.array(sides) - 1 - path
    return np.where(start == low, path, mirrored)


def _blocks(shape: Shape, options: _Options, coarse: tuple[Ints, Ints] | None) -> Iterator[Ints]:
    loose = None if coarse else frozenset((x, y, z) for x, y, z in shape.cells.tolist())
    for attempt in range(options.tries):
        rng = np.random.default_rng([options.seed, attempt])
        if coarse is not None:
            cycle = block_cycle(coarse[0], rng) + coarse[1]
        else:
            cycle = loose_block_cycle(loose or frozenset(), rng)
        if cycle is None:
            if attempt >= PATHS_PER_CANDIDATE:
                return
            continue
        path = _opened(cycle, options)
        if path is not None:
            yield path


def _opened(cycle: Ints, options: _Options) -> Ints | None:
    """Return a cycle, cut open according to the options, or None."""
    if options.start is None:
        path = cut(cycle, int(np.argmin(cut_costs(cycle))))
        return path if _fits(path, options) else None
    at = int(np.flatnonzero((cycle == np.array(options.start)).all(axis=1))[0])
    costs = spreads_of_cuts(cycle)
    ways = [
        (float(costs[at]), cut(cycle, at)),
        (float(costs[(at + 1) % len(cycle)]), cut(cycle, at + 1)[::-1]),
    ]
    fitting = [way for way in ways if _fits(way[1], options)]
    return np.ascontiguousarray(min(fitting, key=lambda way: way[0])[1]) if fitting else None


def _exact(shape: Shape, options: _Options, candidates: int) -> PathSearch:
    paths: list[Ints] = []
    outside = options.ends == "surface"
    for attempt in range(options.tries):
        remaining_s = options.deadline - time.monotonic()
        if attempt and remaining_s <= 0:
            break
        search = exact_path(
            shape,
            time_limit_s=max(remaining_s, 0.0),
            seed=options.seed * 1000 + attempt,
            start=options.start,
            ends_on_surface=outside,
        )
        if search.cells is not None:
            paths.append(search.cells)
            outside = True  # better where it can be had
        elif not paths:
            return PathSearch(paths=(), method="exact", reasons=search.reasons)
        elif options.ends == "surface":
            break
        else:
            outside = False
    too_late = PathReason.of(PathCode.TIME_LIMIT)
    result = _search(shape, paths, candidates, "exact", too_late)
    path_count = min(candidates, options.tries)
    if result.paths and len(paths) < path_count:
        few = PathReason.of(PathCode.FEW_PATHS, paths=len(paths), requested=path_count)
        return replace(result, reasons=(few,))
    return result
