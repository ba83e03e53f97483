"""Bridges: separate parts of a shape, joined by cells that the solid touches."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array, Flags, Ints
from foldback.planner.chain.path import STEPS

Cell = tuple[int, int, int]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bridged:
    """A shape in one piece.

    Attributes:
        cells: (X, Y, Z) True for the cells of the shape.
        parts: Number of parts before joining.
        added: Cells added to join parts.
        dropped: Cells left out: specks, and parts that nothing joins.
    """

    cells: Flags
    parts: int
    added: int
    dropped: int


def parts_of(cells: Flags) -> tuple[NDArray[np.int32], Ints]:
    """Return the part of each cell, counted from 1, and the (P,) sizes of the parts.

    Cells of a part share faces or, if the array has two dimensions, sides.
    """
    from scipy import ndimage  # late: importing it takes a while

    label: Any = ndimage.label
    numbers, _ = label(cells)
    return numbers, np.bincount(numbers.ravel())[1:]


def bridged(cells: Flags, filled: Array) -> Bridged:
    """Join the parts of a shape along the fullest of the cells between them.

    Args:
        cells: (X, Y, Z) True for the cells of the shape, at least one.
        filled: (X, Y, Z) share of each cell that the solid fills; bridges go where it is not 0.
    """
    numbers, sizes = parts_of(cells)
    if len(sizes) == 1:
        return Bridged(cells=cells, parts=1, added=0, dropped=0)
    main = int(np.argmax(sizes)) + 1
    min_size = max(2.0, 0.005 * float(sizes.sum()))  # smaller parts are specks
    order = np.argsort(-sizes, kind="stable") + 1
    parts = {int(p) for p in order[: 64 + 1] if p != main and sizes[p - 1] >= min_size}
    joined = numbers == main
    added = 0
    for end, came_from in _ways(numbers, filled, main, parts) if parts else ():
        joined |= numbers == numbers[end]
        cell: Cell | None = end
        while cell is not None:
            if not joined[cell]:
                part = int(numbers[cell])
                if part:
                    joined |= numbers == part
                else:
                    joined[cell] = True
                    added += 1
            cell = came_from.get(cell)
    dropped = int((cells & ~joined).sum())
    return Bridged(cells=joined, parts=len(sizes), added=added, dropped=dropped)


def _ways(
    numbers: NDArray[np.int32], filled: Array, main: int, parts: set[int]
) -> list[tuple[Cell, dict[Cell, Cell]]]:
    """Return the cheapest bridge to each wanted part: its last cell, and predecessors."""
    remaining = set(parts)
    bridges: list[tuple[Cell, dict[Cell, Cell]]] = []
    cost: dict[Cell, float] = {}
    came_from: dict[Cell, Cell] = {}
    queue: list[tuple[float, Cell]] = []
    for row in np.argwhere(_rim(numbers, filled, main)).tolist():
        start: Cell = (row[0], row[1], row[2])
        cost[start] = 0.0
        queue.append((0.0, start))
    done: set[Cell] = set()
    while queue and remaining:
        paid, cell = heapq.heappop(queue)
        if cell in done:
            continue
        done.add(cell)
        part = int(numbers[cell])
        if part in remaining:
            remaining.discard(part)
            bridges.append((cell, came_from))
        for step in STEPS:
            near: Cell = (cell[0] + step[0], cell[1] + step[1], cell[2] + step[2])
            if min(near) < 0 or any(n >= s for n, s in zip(near, numbers.shape, strict=True)):
                continue
            if near in done or (filled[near] <= 0.0 and not numbers[near]):
                continue
            price = 1e-6 if numbers[near] else 1.0 + 4.0 * (1.0 - float(filled[near]))
            if paid + price < cost.get(near, np.inf):
                cost[near] = paid + price
                came_from[near] = cell
                heapq.heappush(queue, (paid + price, near))
    return bridges


def _rim(numbers: NDArray[np.int32], filled: Array, main: int) -> Flags:
    """Return the (X, Y, Z) cells of the main part at which a bridge may begin."""
    free = np.pad((numbers != main) & ((filled > 0.0) | (numbers > 0)), 1)
    near = np.zeros(free.shape, dtype=np.bool_)
    for axis in range(3):
        near |= np.roll(free, 1, axis) | np.roll(free, -1, axis)
    return near[1:-1, 1:-1, 1:-1] & (numbers == main)
