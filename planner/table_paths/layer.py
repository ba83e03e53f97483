"""Layers: the cells of one height, and paths through all of them.

Sets of cells are whole numbers with a bit for each cell, a row of the layer after the other with an
empty cell between two, so that a shift moves all cells of a set at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from foldback.planner.arrays import Ints

MAX_EXHAUSTIVE_CELLS: Final = 16
"""Maximum number of cells of a layer through which all paths are enumerated; larger layers are
searched at random."""


@dataclass(slots=True)
class Work:
    """Budget of a search: remaining steps, each the extension of a path by a cell."""

    remaining: int

    def spent(self) -> bool:
        """Take one step and return True if the budget is spent."""
        self.remaining -= 1
        return self.remaining < 0


@dataclass(frozen=True, kw_only=True, eq=False)
class Layer:
    """Cells of one height.

    Attributes:
        cells: (m, 2) their x and y.
        index: (m,) indices of the cells among those of the shape.
    """

    cells: Ints
    index: Ints

    @cached_property
    def width(self) -> int:
        """Number of bits from one row to the next."""
        return int(np.ptp(self.cells[:, 1])) + 2

    @cached_property
    def bits(self) -> list[int]:
        """(m,) bit number of each cell."""
        offset = self.cells - self.cells.min(axis=0)
        return [int(bit) for bit in offset[:, 0] * self.width + offset[:, 1] + self.width]

    @cached_property
    def cell_at(self) -> dict[int, int]:
        """Index of the cell of each bit."""
        return {bit: k for k, bit in enumerate(self.bits)}

    @cached_property
    def whole(self) -> int:
        """The set of all cells."""
        return self.set_of(range(len(self.cells)))

    @cached_property
    def steps(self) -> tuple[int, int, int, int]:
        """Bit steps along +x, −x, +y and −y; steps k and k ^ 1 are opposite."""
        return self.width, -self.width, 1, -1

    @cached_property
    def dark(self) -> int:
        """The set of cells of one chessboard colour."""
        return self.set_of(np.flatnonzero(self.cells.sum(axis=1) & 1).tolist())

    @cached_property
    def rays(self) -> dict[int, tuple[int, ...]]:
        """Sets of the cells beyond each bit along each step."""
        return {bit: tuple(self._ray(bit, step) for step in range(4)) for bit in self.bits}

    def set_of(self, cells: range | list[int]) -> int:
        """Return the set of some cells."""
        mask = 0
        for k in cells:
            mask |= 1 << self.bits[k]
        return mask

    def in_one_piece(self, cells: int) -> bool:
        """Return True if a set of cells is connected."""
        width, reached = self.width, cells & -cells
        while True:
            grown = reached | reached << 1 | reached >> 1 | reached << width | reached >> width
            grown &= cells
            if grown == reached:
                return reached == cells
            reached = grown

    def _ray(self, bit: int, step: int) -> int:
        x, y = self.cells[self.cell_at[bit]]
        across, along = (1, 0) if step < 2 else (0, 1)
        sign = 1 if step % 2 == 0 else -1
        in_row = self.cells[:, across] == (x, y)[across]
        beyond = sign * (self.cells[:, along] - (x, y)[along]) > 0
        return self.set_of(np.flatnonzero(in_row & beyond).tolist())


def ways(
    layer: Layer,
    starts: list[int],
    ends: int,
    rng: np.random.Generator,
    *,
    max_ways: int,
    work: Work,
) -> Iterator[tuple[int, ...]]:
    """Yield paths through all cells of a layer, as the bits of the cells in order.

    A small layer's are all found, unless the work ends before; of a larger one's some at random,
    which turn as rarely as they happen to.

    Args:
        layer: The layer.
        starts: Bits that a way may begin with.
        ends: The set of cells that it may end with.
        rng: Random choices.
        max_ways: Maximum number of paths of a large layer.
        work: Budget of the search.
    """
    starts = [start for start in starts if _ends_of(layer, start, ends)]
    if not starts or not layer.in_one_piece(layer.whole):
        return
    results: set[tuple[int, ...]] = set()
    if len(layer.cells) <= MAX_EXHAUSTIVE_CELLS:
        order = [int(k) for k in rng.permutation(len(starts))]
        for k in order:
            for way in _from(layer, starts[k], ends, None, work):
                if way not in results:
                    results.add(way)
                    yield way
        return
    for attempt in range(4 * max_ways):
        if len(results) >= max_ways or work.remaining < 0:
            return
        start = starts[
            attempt % len(starts) if attempt < len(starts) else rng.integers(len(starts))
        ]
        trial = Work(min(40 * len(layer.cells), work.remaining))
        before = trial.remaining
        for way in _from(layer, start, ends, rng, trial):
            if way not in results:
                results.add(way)
                yield way
            break
        work.remaining -= before - trial.remaining


def _ends_of(layer: Layer, start: int, ends: int) -> int:
    """Return the set of possible last cells of a path from a cell, by colours."""
    count, dark = len(layer.cells), layer.dark.bit_count()
    begins_dark = bool(layer.dark >> start & 1)
    first = (count + 1) // 2
    if (dark if begins_dark else count - dark) != first:
        return 0
    ends_dark = begins_dark if count % 2 else not begins_dark
    ends &= layer.dark if ends_dark else layer.whole & ~layer.dark
    return ends if count == 1 else ends & ~(1 << start)


def _from(
    layer: Layer, start: int, ends: int, rng: np.random.Generator | None, work: Work
) -> Iterator[tuple[int, ...]]:
    """Yield paths from one cell by depth-first search, in random order with a generator."""
    ends = _ends_of(layer, start, ends)
    free = layer.whole & ~(1 << start)
    if not free:
        yield (start,)
        return
    style = 0 if rng is None else int(rng.integers(3))
    liked = [0, 1, 2, 3] if rng is None else [int(k) for k in rng.permutation(4)]
    way = [start]
    stack = [_choices(layer, start, free, liked, style, rng)]
    while stack:
        if not stack[-1]:
            stack.pop()
            free |= 1 << way.pop()
            continue
        head = stack[-1].pop()
        if work.spent():
            return
        remaining = free & ~(1 << head)
        if not remaining:
            if ends >> head & 1:
                yield (*way, head)
            continue
        if not _may_go_on(layer, head, remaining, ends):
            continue
        free = remaining
        way.append(head)
        stack.append(_choices(layer, head, free, liked, style, rng))


def _choices(
    layer: Layer,
    head: int,
    free: int,
    liked: list[int],
    style: int,
    rng: np.random.Generator | None,
) -> list[int]:
    """Return the free neighbours of a cell, the first to be tried last.

    Styles: the liked steps first, which makes snakes; cells with the fewest free neighbours first,
    which follows the rim; any.
    """
    choices = [head + layer.steps[k] for k in liked]
    choices = [bit for bit in choices if free >> bit & 1]
    if style == 1:
        choices.sort(key=lambda bit: sum(free >> (bit + step) & 1 for step in layer.steps))
    elif style == 2 and rng is not None:
        choices = [choices[int(k)] for k in rng.permutation(len(choices))]
    return choices[::-1]


def _may_go_on(layer: Layer, head: int, remaining: int, ends: int) -> bool:
    """Return True if no dead end or cut rules out a path through the remaining cells."""
    if not remaining & ends:
        return False
    width, around = layer.width, remaining | 1 << head
    a, b, c, d = around << 1, around >> 1, around << width, around >> width
    reached = (a | b | c | d) & remaining
    if reached != remaining:
        return False
    two = (a & b | c & d | (a | b) & (c | d)) & remaining
    single = remaining & ~two
    if single & (single - 1) or (single and not single & ends):
        return False
    near = 1 << (head + 1) | 1 << (head - 1) | 1 << (head + width) | 1 << (head - width)
    return bool(near & remaining) and layer.in_one_piece(remaining)
