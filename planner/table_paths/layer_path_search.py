"""Search for paths through layers: paths of single layers, joined from the floor up."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from heapq import nsmallest
from typing import Final

import numpy as np

from foldback.planner.arrays import Ints
from foldback.planner.table_paths.base_sides import (
    MIN_BALANCE_MARGIN_PITCH,
    images,
    margins_within,
    support,
)
from foldback.planner.table_paths.layer import MAX_EXHAUSTIVE_CELLS, Layer, Work, ways
from foldback.planner.table_paths.score import WEIGHTS, Parts

POOL_SIZE: Final = 240
"""Maximum number of paths through one layer that are kept, the best first, to be joined with those
of the layers above and below."""
BEAM_WIDTH: Final = 24
"""Number of partial paths, from the table up to one layer, that a beam search keeps for each cell
and direction in which they end."""
VERTICAL: Final = -1
"""Placeholder for the index of the horizontal step of a layer's path that visits a single cell: it
has none, as it enters and leaves the cell vertically."""


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """A path through a layer: bits in order, first and last step (−1 for none), and cost."""

    bits: tuple[int, ...]
    first: int
    last: int
    cost: float


@dataclass(frozen=True, slots=True, eq=False)
class _Beginning:
    cost: float
    way: Way
    heading: int
    below: _Beginning | None


def layers_of(cells: Ints) -> list[Layer]:
    """Return the layers of cells that stand at z = 0, from the floor up."""
    heights = range(int(cells[:, 2].max()) + 1)
    index = [np.flatnonzero(cells[:, 2] == height) for height in heights]
    return [Layer(cells=cells[rows, :2], index=rows) for rows in index]


class Climb:
    """Beam search for paths through the layers of a shape that never go down.

    Ways are found from the floor up: those through the next layer begin above the ends of those
    through the last one, so that most of them can be joined.
    """

    def __init__(self, cells: Ints, rng: np.random.Generator, weights: Parts = WEIGHTS) -> None:
        self.cells, self.rng, self.weights = cells, rng, weights
        self.layers = layers_of(cells)
        self.pools: list[dict[tuple[int, ...], Way]] = [{} for _ in self.layers]
        self.edges = support(cells[cells[:, 2] == 0])

    def search(self, work: Work) -> None:
        """Fill the pools of all layers within the budget."""
        allowed: list[int] = [int(b) for b in self.layers[0].bits]
        for level, layer in enumerate(self.layers):
            share = Work(work.remaining // (len(self.layers) - level))
            before = share.remaining
            ends = self._below_cells(level)
            for way in ways(layer, allowed, ends, self.rng, max_ways=48, work=share):
                self.add(level, way)
            work.remaining -= before - share.remaining
            self._thin(level)
            if not self.pools[level]:
                return
            allowed = self._above(level, {way[-1] for way in self.pools[level]})

    def add_path(self, order: Iterable[int]) -> None:
        """Add the parts of a path through all layers to the pools.

        Args:
            order: Indices of the cells along a path that never goes down.
        """
        place = {int(k): (z, i) for z, la in enumerate(self.layers) for i, k in enumerate(la.index)}
        split: list[list[int]] = [[] for _ in self.layers]
        for k in order:
            level, at = place[k]
            split[level].append(self.layers[level].bits[at])
        for level, way in enumerate(split):
            self.add(level, tuple(way))

    def add(self, level: int, bits: tuple[int, ...]) -> None:
        """Add a path to a layer's pool, unless the cells tip over along it."""
        cost = self._cost(level, bits)
        if cost is not None:
            steps = self.layers[level].steps
            at = [steps.index(b - a) for a, b in zip(bits, bits[1:], strict=False)]
            first, last = (at[0], at[-1]) if at else (VERTICAL, VERTICAL)
            self.pools[level][bits] = Way(bits, first, last, cost)

    def best(self, count: int) -> list[Ints]:
        """Return the best paths through all layers as indices of cells, the best first."""
        now: dict[tuple[int, int], list[_Beginning]] = {}
        for way in self._different_on_the_floor():
            if way.last != VERTICAL:
                key = way.bits[-1], way.last
                now.setdefault(key, []).append(_Beginning(way.cost, way, way.last, None))
        for level in range(1, len(self.layers)):
            now = self._joined(
                level, {k: nsmallest(BEAM_WIDTH, v, key=_cost) for k, v in now.items()}
            )
        everything = [beginning for group in now.values() for beginning in group]
        return [self._order(beginning) for beginning in nsmallest(count, everything, key=_cost)]

    def _joined(
        self, level: int, below: dict[tuple[int, int], list[_Beginning]]
    ) -> dict[tuple[int, int], list[_Beginning]]:
        extended: dict[tuple[int, int], list[_Beginning]] = {}
        under = self._under(level)
        weight = self.weights.bends / len(self.cells)
        behind = int((self.cells[:, 2] >= level).sum())
        roll = self.weights.rolls * behind / len(self.cells)
        for way in self.pools[level].values():
            merged: list[tuple[float, int, _Beginning]] = []
            for heading in range(4):
                if way.first != VERTICAL and way.first == heading ^ 1:
                    continue
                rolled = roll if way.first not in (VERTICAL, heading) else 0.0
                for beginning in below.get((under[way.bits[0]], heading), ()):
                    merged.append((beginning.cost + rolled, len(merged), beginning))
            for cost, _, beginning in nsmallest(BEAM_WIDTH, merged):
                heading = beginning.heading if way.last == VERTICAL else way.last
                bends = (beginning.way.last != VERTICAL) + (way.first != VERTICAL)
                joined = _Beginning(cost + way.cost + bends * weight, way, heading, beginning)
                extended.setdefault((way.bits[-1], heading), []).append(joined)
        return extended

    def _order(self, end: _Beginning) -> Ints:
        rows: list[list[int]] = []
        beginning: _Beginning | None = end
        for layer in reversed(self.layers):
            assert beginning is not None
            rows.append([int(layer.index[layer.cell_at[bit]]) for bit in beginning.way.bits])
            beginning = beginning.below
        return np.array([k for way in reversed(rows) for k in way], dtype=np.int64)

    def _cost(self, level: int, bits: tuple[int, ...]) -> float | None:
        """Estimate what a layer's path adds to the score; None if the cells tip over along it."""
        layer = self.layers[level]
        way = layer.cells[[layer.cell_at[bit] for bit in bits]]
        tipping = 0.0
        if level:
            below = self.cells[self.cells[:, 2] < level][:, :2]
            counts = len(below) + np.arange(1, len(way) + 1)
            centres = (below.sum(axis=0) + np.cumsum(way, axis=0)) / counts[:, None]
            margin = float(margins_within(self.edges, centres).min())
            if margin < MIN_BALANCE_MARGIN_PITCH:
                return None
            tipping = max(0.0, 1.0 - margin)
        before, enclosed, swing, outs = 0, 0, 0.0, -1
        for bit in bits:
            free = [k for k, ray in enumerate(layer.rays[bit]) if not ray & before]
            before |= 1 << bit
            enclosed += not free
            if free and outs not in free:
                swing += outs >= 0
                outs = free[0]
        bends = sum(c - b != b - a for a, b, c in zip(bits, bits[1:], bits[2:], strict=False))
        w = self.weights
        sums = w.bends * bends + w.enclosed * enclosed + w.swing * swing
        sums += 0.0 if len(way) < 3 else w.front * 0.5 * _run(way)
        return float(sums / len(self.cells) + w.tipping * tipping / len(self.layers))

    def _thin(self, level: int) -> None:
        """Keep the best paths of a pool, and the best one of each pair of ends."""
        pool = self.pools[level]
        if len(pool) <= POOL_SIZE:
            return
        ranked = sorted(pool, key=lambda bits: (pool[bits].cost, bits))
        representatives: dict[tuple[int, ...], tuple[int, ...]] = {}
        for bits in ranked:
            way = pool[bits]
            representatives.setdefault((bits[0], way.first, bits[-1], way.last), bits)
        pool_bits = dict.fromkeys([*representatives.values(), *ranked[:POOL_SIZE]])
        self.pools[level] = {bits: pool[bits] for bits in pool_bits}

    def _below_cells(self, level: int) -> int:
        """Return the cells of a layer that have one above them; all of the highest layer."""
        layer = self.layers[level]
        if level + 1 == len(self.layers):
            return layer.whole
        above = {tuple(cell) for cell in self.layers[level + 1].cells.tolist()}
        return layer.set_of([k for k, c in enumerate(layer.cells.tolist()) if tuple(c) in above])

    def _above(self, level: int, bits: set[int]) -> list[int]:
        if level + 1 == len(self.layers):
            return []
        return sorted(bit for bit, low in self._under(level + 1).items() if low in bits)

    def _under(self, level: int) -> dict[int, int]:
        """Return the bit under each bit of a layer, −1 without a cell."""
        layer, low = self.layers[level], self.layers[level - 1]
        bit_of_cell = {
            tuple(cell): bit for cell, bit in zip(low.cells.tolist(), low.bits, strict=True)
        }
        pairs = zip(layer.cells.tolist(), layer.bits, strict=True)
        return {bit: bit_of_cell.get(tuple(cell), -1) for cell, bit in pairs}

    def _different_on_the_floor(self) -> list[Way]:
        """Return the paths of the lowest layer that differ under the shape's symmetries.

        All paths are returned for large layers: continuations of one may be missing for another.
        """
        if max(len(layer.cells) for layer in self.layers) > MAX_EXHAUSTIVE_CELLS:
            return list(self.pools[0].values())
        symmetries_of_cells = _symmetries(self.cells)
        layer = self.layers[0]
        different: dict[bytes, Way] = {}
        for way in sorted(self.pools[0].values(), key=lambda way: (way.cost, way.bits)):
            path = np.column_stack(
                [layer.cells[[layer.cell_at[bit] for bit in way.bits]], np.zeros(len(way.bits))]
            ).astype(np.int64)
            turned = [
                image.tobytes() for k, image in enumerate(images(path)) if k in symmetries_of_cells
            ]
            different.setdefault(min(turned), way)
        return list(different.values())


def _symmetries(cells: Ints) -> list[int]:
    """Return the indices of the eight symmetries about the vertical that keep a shape."""
    looks = [frozenset(map(tuple, image.tolist())) for image in images(cells)]
    return [k for k, look in enumerate(looks) if look == looks[0]]


def _cost(beginning: _Beginning) -> float:
    return beginning.cost


def _run(way: Ints) -> float:
    """Return the distance that the middle of neighbouring cells moves along a path, pitches."""
    middles = (way[2:] + way[:-2]) / 2.0
    return float(np.linalg.norm(np.diff(middles, axis=0), axis=1).sum())
