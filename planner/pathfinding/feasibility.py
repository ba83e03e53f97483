"""Feasibility: proofs that a chain can or cannot fill a shape, and small repairs."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final, TypeAlias

import numpy as np

from foldback.planner.arrays import Ints
from foldback.planner.chain.path import MIN_CELLS, STEPS
from foldback.planner.pathfinding import Cell
from foldback.planner.pathfinding.block_merging import halved
from foldback.planner.pathfinding.exact_search import exact_path
from foldback.planner.pathfinding.lattice import colours, neighbours, parts, tuples
from foldback.planner.pathfinding.no_path_proofs import Problem, obstacles, written
from foldback.planner.pathfinding.path_reasons import PathCode, PathReason
from foldback.planner.pathfinding.snake import is_box
from foldback.planner.shapes.shape import Shape

__all__ = ["Feasibility", "Problem", "Repair", "apply_repair", "feasibility", "named_cells"]

Cells: TypeAlias = frozenset[Cell]

PARITY_CODES: Final = (PathCode.PARITY, PathCode.UNEVEN_PART)
"""Codes of problems that cells of one colour of a chessboard mend."""

MAX_CHANGES: Final = 12
"""Number of cells that a repair (a changed shape that has a path) may add or drop in any shape;
shapes of more than 120 cells may change by a tenth of their cells. Also the maximum number of cells
that join separate parts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Repair:
    """A change that makes a path possible.

    Attributes:
        detail: One plain sentence.
        done: The change as a sentence about the past, to follow a colon.
        add: Cells to add.
        drop: Cells to drop.
        doubled: True to split each cell into 2×2×2 cells of half the pitch then.
    """

    detail: str
    done: str
    add: tuple[Cell, ...] = ()
    drop: tuple[Cell, ...] = ()
    doubled: bool = False

    @property
    def as_step(self) -> str:
        """The change, to follow a colon."""
        return f"{self.detail[:1].lower()}{self.detail[1:]}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Feasibility:
    """Answer to the question if a chain can fill a shape.

    Attributes:
        feasible: True or False if proved, else None.
        problems: Proofs that there is no path.
        repairs: Repairs, the smallest first; doubling, which always works, last.
    """

    feasible: bool | None
    problems: tuple[Problem, ...] = ()
    repairs: tuple[Repair, ...] = ()


def feasibility(shape: Shape, *, seed: int = 0, time_limit_s: float = 2.0) -> Feasibility:
    """Search for proofs that a shape has no path, for a path, and for repairs.

    Args:
        shape: The shape.
        seed: Seed of the searches.
        time_limit_s: Wall-clock limit of the search for a path, and again for repairs, s.
    """
    problems = obstacles(shape.cells)
    exists: bool | None = None
    if problems:
        exists = False
    elif is_box(shape) or halved(shape) is not None:
        exists = True
    elif len(shape) <= 2_000:
        search = exact_path(shape, time_limit_s=time_limit_s, seed=seed, eased=False)
        exists = {"found": True, "infeasible": False, "undecided": None}[search.status]
        if exists is False:
            problems = (Problem(reason=PathReason.of(PathCode.NO_PATH)),)
    if exists:
        return Feasibility(feasible=True)
    deadline = time.monotonic() + time_limit_s
    repairs = tuple(_repairs(shape, problems, seed, deadline))
    return Feasibility(feasible=exists, problems=problems, repairs=repairs)


def apply_repair(shape: Shape, repair: Repair) -> Shape:
    """Return the shape after a repair."""
    cells = np.array(sorted((_set(shape.cells) | set(repair.add)) - set(repair.drop)))
    pitch_m = shape.pitch_m
    if repair.doubled:
        corners = np.array(list(product((0, 1), repeat=3)))
        cells = (2 * cells[:, None, :] + corners).reshape(-1, 3)
        pitch_m /= 2
    return Shape.from_cells(cells, name=shape.name, pitch_m=pitch_m)


def _repairs(
    shape: Shape, problems: tuple[Problem, ...], seed: int, deadline: float
) -> Iterator[Repair]:
    """Yield verified changes, the smallest first, then doubling."""
    before = _set(shape.cells)
    bases = [before]
    if any(problem.code is PathCode.DISCONNECTED for problem in problems):
        bases = [_bridged(shape.cells), _largest_part(shape.cells)]
    repairs = [
        repair
        for base in bases
        if base is not None
        for adding in (False, True)
        if (repair := _mended(before, base, adding, seed, deadline)) is not None
    ]
    different = {(repair.add, repair.drop): repair for repair in repairs}
    yield from sorted(different.values(), key=lambda r: (len(r.add) + len(r.drop), len(r.drop)))
    basis = bases[0] if bases[0] is not None else bases[-1] or before
    yield _doubling(before, basis)


def _mended(before: Cells, base: Cells, adding: bool, seed: int, deadline: float) -> Repair | None:
    """Add or drop cells one at a time, each time the one that helps most."""
    now = base
    for _ in range(max(MAX_CHANGES, int(0.1 * len(base))) + 1):
        problems = obstacles(_array(now))
        if not problems:
            if now != before and _has_path(now, seed):
                return _repair(before, now)
            if time.monotonic() > deadline:
                return None
        # A single change flips the balance of colours by one; without any problem left to guide,
        # any cell is tried whose result has a path.
        amount = sum(problem.amount for problem in problems)
        best: tuple[int, int, Cell] | None = None
        for rank, cell in enumerate(_choices(now, problems, adding)):
            after = now | {cell} if adding else now - {cell}
            remaining = sum(problem.amount for problem in obstacles(_array(after)))
            if not problems:
                if remaining == 0 and _has_path(after, seed):
                    return _repair(before, after)
            elif remaining < amount and (best is None or (remaining, rank, cell) < best):
                best = remaining, rank, cell
            if time.monotonic() > deadline:
                break
        if best is None:
            return None
        now = now | {best[2]} if adding else now - {best[2]}
    return None


def _choices(now: Cells, problems: tuple[Problem, ...], adding: bool) -> tuple[Cell, ...]:
    """Return cells to add or to drop, the least visible first."""
    cells = _array(now)
    if adding:
        around = {_plus(cell, step) for cell in now for step in STEPS} - now
        candidates = _array(frozenset(around))
        filled = np.array([sum(_plus(c, s) in now for s in STEPS) for c in tuples(candidates)])
        looks = -filled
    else:
        filled = (neighbours(cells) >= 0).sum(axis=1)
        candidates, looks = cells[filled < 6], filled[filled < 6]
    balance = int((1 - 2 * colours(cells)).sum())
    if problems and all(problem.code in PARITY_CODES for problem in problems) and abs(balance) > 1:
        majority_colour = 0 if balance > 0 else 1
        colour = 1 - majority_colour if adding else majority_colour
        keep = colours(candidates) == colour
        candidates, looks = candidates[keep], looks[keep]
        far = np.zeros(len(candidates))
    else:
        spots = np.array([cell for problem in problems for cell in problem.cells][:200])
        far = (
            np.abs(candidates[:, None, :] - spots[None]).sum(axis=2).min(axis=1)
            if len(spots)
            else np.zeros(len(candidates))
        )
        far = np.maximum(far - 2, 0)
    order = np.lexsort((*candidates.T, looks, far))
    return tuples(candidates[order][:60])


def _has_path(cells: Cells, seed: int) -> bool:
    shape = Shape.from_cells(_array(cells))
    if is_box(shape) or halved(shape) is not None:
        return True
    return exact_path(shape, time_limit_s=0.5, seed=seed, eased=False).status == "found"


def _repair(before: Cells, after: Cells) -> Repair:
    add, drop = tuple(sorted(after - before)), tuple(sorted(before - after))
    detail, done = (
        " and ".join(f"{verb} {named_cells(cells)}" for verb, cells in changes if cells)
        for changes in ((("add", add), ("remove", drop)), (("added", add), ("removed", drop)))
    )
    sentence = f"{detail[:1].upper()}{detail[1:]}."
    return Repair(detail=sentence, done=f"{done}.", add=add, drop=drop)


def named_cells(cells: Sequence[Cell]) -> str:
    """Return a few cells by name, more by number."""
    if len(cells) > 3:
        return _count(len(cells), "cell")
    return f"the cell{'s' * (len(cells) > 1)} {written(cells)}"


def _doubling(before: Cells, basis: Cells) -> Repair:
    add, drop = tuple(sorted(basis - before)), tuple(sorted(before - basis))
    split = "split each cell into 2×2×2 cells"
    detail, done = split.capitalize(), split
    if add:
        bridge = f"{_count(len(add), 'cell')} as a bridge, then {split}"
        detail, done = f"Add {bridge}", f"added {bridge}"
    elif drop:
        removal = f"{_count(len(drop), 'cell')}, then split each remaining cell into 2×2×2 cells"
        detail, done = f"Remove {removal}", f"removed {removal}"
    outcome = (
        f". This makes {8 * len(basis)} modules of half the size, and there is always a path "
        "through them."
    )
    return Repair(
        detail=detail + outcome,
        done=done + outcome,
        add=add,
        drop=drop,
        doubled=True,
    )


def _count(number: int, word: str) -> str:
    return f"{number} {word}{'s' * (number != 1)}"


def _largest_part(cells: Ints) -> Cells | None:
    """Return the largest part, None if it is too small for a chain."""
    _, labels = parts(cells)
    largest = cells[labels == np.argmax(np.bincount(labels))]
    return _set(largest) if len(largest) >= MIN_CELLS else None


def _bridged(cells: Ints) -> Cells | None:
    """Join all parts by the shortest bridges; None if they take too many cells."""
    added = 0
    while (labelled := parts(cells))[0] > 1:
        labels = labelled[1]
        largest = labels == np.argmax(np.bincount(labels))
        inner, outer = cells[largest], cells[~largest]
        if len(inner) * len(outer) > 4_000_000:
            return None
        gaps = np.abs(inner[:, None, :] - outer[None]).sum(axis=2)
        a, b = np.unravel_index(int(gaps.argmin()), gaps.shape)
        bridge = _between(inner[a], outer[b])
        added += len(bridge)
        if added > MAX_CHANGES:
            return None
        cells = np.concatenate([cells, bridge])
    return _set(cells)


def _between(a: Ints, b: Ints) -> Ints:
    """Return the cells of a bent line strictly between two cells."""
    at, line = a.copy(), list[Ints]()
    for axis in range(3):
        while at[axis] != b[axis]:
            at[axis] += np.sign(b[axis] - at[axis])
            line.append(at.copy())
    return np.array(line[:-1], dtype=np.int64).reshape(-1, 3)


def _plus(a: Cell, b: Cell) -> Cell:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _set(cells: Ints) -> Cells:
    return frozenset(tuples(cells))


def _array(cells: Cells) -> Ints:
    return np.array(sorted(cells), dtype=np.int64).reshape(-1, 3)
