"""Assembly order: paths whose cells come off one after the other, from the far end.

Such a path could have been laid cell by cell, each unit coming in along a free line. Boxes get a
snake, layer by layer; doubled cells a way through each layer (``planner.shapes.layered_path``).
Where layers fall into parts, blocks are visited along a coarse path that is found by a depth-first
search: low layers first, narrow places first, and each new block with a free line to the outside at
its turn. Within a block of an even side a snake joins two corners that differ in one coordinate, so
for every coarse path there is a choice of snakes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from foldback.planner.arrays import Ints
from foldback.planner.pathfinding.lattice import neighbours
from foldback.planner.pathfinding.removal_analysis import analyse_removal
from foldback.planner.pathfinding.snake import snake_path
from foldback.planner.shapes.layered_path import layered_path


def from_better_end(cells: Ints) -> Ints:
    """Return the (n, 3) path, reversed if that is easier to remove from its last cell."""
    turned = np.ascontiguousarray(cells[::-1])
    return turned if analyse_removal(turned).score > analyse_removal(cells).score else cells


def layered_snake(sides: tuple[int, int, int]) -> Ints:
    """Return the (n, 3) snake through a box with the smallest layers and the shortest rows."""
    order = np.argsort(sides, kind="stable")
    return snake_path(sides, axes=(int(order[0]), int(order[1]), int(order[2])))


def assembly_path(coarse: Ints, rng: np.random.Generator, *, side: int = 2) -> Ints | None:
    """Return a path in assembly order through blocks, or None.

    Args:
        coarse: (m, 3) the blocks; block b holds the cells side · b + {0 … side − 1}³.
        rng: Random choice between equals.
        side: Cells along each edge of a block, even.

    Returns:
        (m · side³, 3) the cells in order.
    """
    if side < 2 or side % 2:
        raise ValueError(f"got blocks {side} cells wide, expected an even width of at least 2")
    blocks = np.unique(np.asarray(coarse, dtype=np.int64), axis=0)
    order = coarse_path(blocks, rng)
    return None if order is None else filled_blocks(blocks[order], side)


def solid_paths(coarse: Ints, rng: np.random.Generator, side: int) -> Iterator[Ints]:
    """Yield paths in assembly order: by layers along each axis, else by blocks."""
    corners = np.argwhere(np.ones((2, 2, 2), dtype=bool))
    blocks = {side: coarse}
    while side > 2:
        side //= 2
        blocks[side] = (2 * blocks[2 * side][:, None] + corners).reshape(-1, 3)
    layered = False
    for axis in np.argsort(-np.ptp(coarse, axis=0), kind="stable").tolist():
        path = layered_path(blocks[2], axis, rng)
        if path is not None:
            layered = True
            yield from_better_end(path)
    if layered:
        return
    for length, cells in blocks.items():
        for _ in range(3):
            path = assembly_path(cells, rng, side=length)
            if path is None:
                break
            yield from_better_end(path)


def coarse_path(blocks: Ints, rng: np.random.Generator) -> Ints | None:
    """Return the (m,) blocks in assembly order, each touching the next, or None."""
    near = neighbours(blocks)
    black = int((blocks.sum(axis=1) & 1).sum())
    if abs(len(blocks) - 2 * black) > 1:
        return None
    for attempt in range(6):
        axis = (2, 1, 0)[attempt % 3]
        order = _Search(blocks, near, axis, rng).run(
            min(10 * len(blocks), 6000 + len(blocks))  # longer searches order no more paths
        )
        if order is not None:
            return np.array(order, dtype=np.int64)
    return None


class _Search:
    """A depth-first search for a path through all blocks, each free at its turn."""

    def __init__(self, blocks: Ints, near: Ints, axis: int, rng: np.random.Generator) -> None:
        self.count = len(blocks)
        self.near = [[int(b) for b in row if b >= 0] for row in near]
        self.lines = _lines(blocks)
        self.placed = [False] * self.count
        self.degree = [len(row) for row in self.near]
        height = blocks[:, axis] - blocks[:, axis].min()
        # the lowest layers first, so that a path can be built upwards
        self.key = (3.0 * height + rng.uniform(0.0, 1.0, self.count)).tolist()

    def run(self, visits: int) -> list[int] | None:
        start = min(range(self.count), key=lambda b: self.key[b] + self.degree[b])
        path = [start]
        self._place(start)
        waiting = [self._choices(start)]
        while waiting and visits:
            visits -= 1
            if len(path) == self.count:
                return path
            if waiting[-1]:
                block = waiting[-1].pop()
                self._place(block)
                path.append(block)
                waiting.append(self._choices(block))
            else:
                waiting.pop()
                self._take(path.pop())
        return path if len(path) == self.count else None

    def _place(self, block: int) -> None:
        self.placed[block] = True
        for neighbour in self.near[block]:
            self.degree[neighbour] -= 1

    def _take(self, block: int) -> None:
        self.placed[block] = False
        for neighbour in self.near[block]:
            self.degree[neighbour] += 1

    def _choices(self, block: int) -> list[int]:
        """Return the candidates for the next block, the best last."""
        free = [b for b in self.near[block] if not self.placed[b]]
        # A neighbour whose only way in is from here must come next, or be the end.
        lonely = [b for b in free if self.degree[b] == 0]
        remaining = self.count - sum(self.placed) if lonely else 0
        if lonely and remaining > 1:
            return []
        tight = [b for b in free if self.degree[b] == 1]
        if len(tight) > 2:
            return []
        choices = [b for b in free if self._has_way(b)]
        choices.sort(key=lambda b: -(self.key[b] + self.degree[b]))
        return choices

    def _has_way(self, block: int) -> bool:
        """Return True if a straight line leads from a block outside past all placed blocks."""
        return any(not any(self.placed[b] for b in line) for line in self.lines[block])


def _lines(blocks: Ints) -> list[list[list[int]]]:
    """Return for each block and direction the blocks beyond it in its row, behind gaps too."""
    low = blocks.min(axis=0)
    grid = np.full(blocks.max(axis=0) - low + 1, -1, dtype=np.int64)
    grid[tuple((blocks - low).T)] = np.arange(len(blocks))
    lines: list[list[list[int]]] = []
    for x, y, z in (blocks - low).tolist():
        rows = (
            (grid[x + 1 :, y, z], grid[:x, y, z]),
            (grid[x, y + 1 :, z], grid[x, :y, z]),
            (grid[x, y, z + 1 :], grid[x, y, :z]),
        )
        lines.append([[b for b in way.tolist() if b >= 0] for row in rows for way in row])
    return lines


def filled_blocks(order: Ints, side: int) -> Ints:
    """Return the (m · side³, 3) cells along a path of blocks, a snake in each.

    Args:
        order: (m, 3) blocks, each touching the next.
        side: Cells along each edge, even.
    """
    corner = np.zeros(3, dtype=np.int64)
    if len(order) > 1:
        first = order[1] - order[0]
        axis = int(np.argmax(np.abs(first)))
        corner[axis] = int(first[axis] < 0)  # begin on the far side: the snake runs to the exit
    parts: list[Ints] = []
    for k, block in enumerate(order):
        step = order[k + 1] - block if k + 1 < len(order) else None
        axis, after = _exit(corner, step)
        parts.append(side * block + _block_snake(corner, axis, side))
        if step is not None:
            corner = after.copy()
            corner[int(np.argmax(np.abs(step)))] ^= 1
    return np.concatenate(parts)


def _exit(corner: Ints, step: Ints | None) -> tuple[int, Ints]:
    """Return the axis along which a block is traversed, and its last corner."""
    leave = corner.copy()
    if step is None:
        leave[2] ^= 1
        return 2, leave
    way = int(np.argmax(np.abs(step)))
    bit = int(step[way] > 0)
    axis = way if corner[way] != bit else (way + 1) % 3
    leave[axis] ^= 1
    return axis, leave


def _block_snake(corner: Ints, axis: int, side: int) -> Ints:
    """Return the (side³, 3) snake from a corner to the one at the other end of an axis."""
    other_axes = [k for k in range(3) if k != axis]
    cells = snake_path((side, side, side), axes=(other_axes[0], other_axes[1], axis))
    return np.where(corner == 1, side - 1 - cells, cells)
