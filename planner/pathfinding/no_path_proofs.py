"""No-path proofs: proofs, quickly found and easily checked, that no path visits all cells."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from foldback.planner.arrays import Ints
from foldback.planner.chain.path import MIN_CELLS
from foldback.planner.pathfinding import Cell
from foldback.planner.pathfinding.end_proofs import end_proof
from foldback.planner.pathfinding.lattice import colours, neighbours, parts, tuples
from foldback.planner.pathfinding.path_reasons import PathCode, PathReason

MAX_NAMED_CELLS: Final = 200
"""Maximum number of cells that the report of a shape without a path lists as the cause of one
problem; further ones are left out. Sets that need too many ends are listed whole."""
COUNTED: Final = (PathCode.DEAD_ENDS, PathCode.CUT_CELLS, PathCode.ARMS, PathCode.ENDS)
"""Codes of the problems whose cells a reader needs to check them by counting."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """Proof that there is no path.

    Attributes:
        reason: The observation and the need of a path.
        cells: Affected cells, at most ``MAX_NAMED_CELLS``; of ``ends`` all, so that the proof can
            be checked by counting.
        amount: Severity, roughly the cells by which a path is missed; larger is worse.
    """

    reason: PathReason
    cells: tuple[Cell, ...] = ()
    amount: int = 1

    @property
    def code(self) -> PathCode:
        """Code of the reason."""
        return self.reason.code

    @property
    def sentence(self) -> str:
        """The reason; with its cells where they are few and a reader needs them to check it."""
        text = self.reason.sentence
        if self.code not in COUNTED or not 0 < len(self.cells) <= 8:
            return text
        subject = "The cells are" if len(self.cells) > 1 else "The cell is"
        return f"{text} {subject} {written(self.cells)}."


def written(cells: Sequence[Cell]) -> str:
    """Return cells as words: (1, 0, 2), (3, 0, 2) and (4, 0, 2)."""
    *first, last = map(str, cells)
    return f"{', '.join(first)} and {last}" if first else last


def obstacles(cells: Ints) -> tuple[Problem, ...]:
    """Return proofs that no path visits all these cells; empty without one.

    Args:
        cells: (n, 3) distinct cells.
    """
    problems = tuple(_obstacles(cells))
    return problems or tuple(_ends(cells))


def _obstacles(cells: Ints) -> Iterator[Problem]:
    n = len(cells)
    if n < MIN_CELLS:
        yield Problem(
            reason=PathReason.of(PathCode.TOO_FEW, count=n, minimum=MIN_CELLS),
            cells=_named(cells),
            amount=MIN_CELLS - n,
        )
        return
    count, labels = parts(cells)
    if count > 1:
        yield disconnected(cells, labels)
        return
    balance = 1 - 2 * colours(cells)
    excess = abs(int(balance.sum()))
    if excess > 1:
        black = (n + excess) // 2
        yield Problem(
            reason=PathReason.of(PathCode.PARITY, black=black, white=n - black),
            cells=_named(cells[balance == np.sign(balance.sum())]),
            amount=excess - 1,
        )
    near = neighbours(cells)
    dead = np.flatnonzero((near >= 0).sum(axis=1) == 1)
    if len(dead) > 2:
        yield Problem(
            reason=PathReason.of(PathCode.DEAD_ENDS, count=len(dead)),
            cells=_named(cells[dead]),
            amount=len(dead) - 2,
        )
    yield from _cut_cells(cells, near, balance)


def disconnected(cells: Ints, labels: Ints) -> Problem:
    """Return the proof for cells in several parts.

    Args:
        cells: (n, 3) the cells.
        labels: (n,) number of each cell's part, from ``lattice.parts``.
    """
    sizes = np.bincount(labels)
    largest = int(np.argmax(sizes))
    return Problem(
        reason=PathReason.of(
            PathCode.DISCONNECTED,
            parts=len(sizes),
            largest=int(sizes[largest]),
            count=len(cells),
        ),
        cells=_named(cells[labels != largest]),
        amount=1000 * (len(sizes) - 1),
    )


def _named(cells: Ints) -> tuple[Cell, ...]:
    """Return the first ``MAX_NAMED_CELLS`` cells as tuples."""
    return tuples(cells[:MAX_NAMED_CELLS])


def _cut_cells(cells: Ints, near: Ints, balance: Ints) -> Iterator[Problem]:
    pieces = _pieces(near, balance)
    split = [cell for cell, sums in pieces.sums.items() if len(sums) > 2]
    if split:
        part_count = max(len(pieces.sums[cell]) for cell in split)
        yield Problem(
            reason=PathReason.of(PathCode.CUT_CELLS, parts=part_count),
            cells=_named(cells[sorted(split)]),
            amount=sum(_beyond_two(pieces.sizes[cell]) for cell in split),
        )
    branching = {piece: cuts for piece, cuts in enumerate(pieces.cuts) if len(cuts) > 2}
    if branching:
        yield Problem(
            reason=PathReason.of(PathCode.ARMS, arms=max(map(len, branching.values()))),
            cells=_named(cells[sorted({cell for cuts in branching.values() for cell in cuts})]),
            amount=sum(_beyond_two(pieces.arms[piece]) for piece in branching),
        )
    if split or branching:
        return
    # What lies on one side of a cut cell is visited in one go that begins next to the cut cell.
    uneven = [
        (cell, amount)
        for cell, sums in pieces.sums.items()
        if (amount := sum(max(s, -1 - s, 0) for s in (s * int(balance[cell]) for s in sums)))
    ]
    if uneven:
        yield Problem(
            reason=PathReason.of(PathCode.UNEVEN_PART),
            cells=_named(cells[sorted(cell for cell, _ in uneven)]),
            amount=max(amount for _, amount in uneven),
        )


def _ends(cells: Ints) -> Iterator[Problem]:
    """Yield the proof that degrees give, for cells without any simpler problem."""
    if len(cells) > 2_000:  # the maximum flow takes 10 µs for each cell
        return
    proof = end_proof(neighbours(cells), 1 - 2 * colours(cells))
    if proof is not None:
        yield Problem(
            reason=PathReason.of(
                PathCode.ENDS,
                count=len(proof.members),
                around=proof.around,
                places=proof.places,
                needed=proof.needed,
                allowed=proof.allowed,
            ),
            cells=tuples(cells[proof.members]),
            amount=proof.missed,
        )


def _beyond_two(sizes: list[int]) -> int:
    """Return the number of cells besides the two largest parts."""
    return sum(sorted(sizes)[:-2])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pieces:
    """Biconnected pieces of a shape and the parts around its cut cells.

    Attributes:
        sums: Balance of colours of every part around each cut cell.
        sizes: Number of cells of every part around each cut cell.
        cuts: Cut cells of each biconnected piece.
        arms: Number of cells beyond each of these cut cells, seen from the piece.
    """

    sums: dict[int, list[int]]
    sizes: dict[int, list[int]]
    cuts: list[list[int]]
    arms: list[list[int]]


def _pieces(near: Ints, balance: Ints) -> _Pieces:
    """Find the biconnected components of a connected graph (Hopcroft and Tarjan, 1973)."""
    links = [[index for index in row if index >= 0] for row in near.tolist()]
    weight = balance.tolist()
    n = len(links)
    number, low, below = [-1] * n, [0] * n, list(weight)
    counts, next_link, parent = [1] * n, [0] * n, [-1] * n
    number[0] = 0
    stack, piece, counted = [0], [0], 1
    members: list[list[int]] = []
    hung: dict[int, list[int]] = {}  # the first cells of what hangs on a cell
    while stack:
        cell = stack[-1]
        if next_link[cell] < len(links[cell]):
            neighbour = links[cell][next_link[cell]]
            next_link[cell] += 1
            if number[neighbour] < 0:
                parent[neighbour] = cell
                number[neighbour] = low[neighbour] = counted
                counted += 1
                stack.append(neighbour)
                piece.append(neighbour)
            elif neighbour != parent[cell]:
                low[cell] = min(low[cell], number[neighbour])
            continue
        stack.pop()
        if not stack:
            break
        above = parent[cell]
        below[above] += below[cell]
        counts[above] += counts[cell]
        low[above] = min(low[above], low[cell])
        if low[cell] >= number[above]:
            hung.setdefault(above, []).append(cell)
            at = _index(piece, cell)
            members.append([above, *piece[at:]])
            del piece[at:]
    return _joined_pieces(members, hung, weight, below, counts)


def _joined_pieces(
    members: list[list[int]],
    hung: dict[int, list[int]],
    weight: list[int],
    below: list[int],
    counts: list[int],
) -> _Pieces:
    sums: dict[int, list[int]] = {}
    sizes: dict[int, list[int]] = {}
    for cell, firsts in hung.items():
        if cell or len(firsts) > 1:
            sums[cell] = [below[first] for first in firsts]
            sizes[cell] = [counts[first] for first in firsts]
        if cell:
            sums[cell].append(below[0] - sum(sums[cell]) - weight[cell])
            sizes[cell].append(counts[0] - sum(sizes[cell]) - 1)
    cuts = [[cell for cell in piece if cell in sums] for piece in members]
    arms: list[list[int]] = []
    for piece, cut_cells in zip(members, cuts, strict=True):
        # The piece lies below its own first cell and above what hangs on the others.
        counts_of_cuts = [
            counts[piece[1]] if cell == piece[0] else sizes[cell][-1] for cell in cut_cells
        ]
        arms.append([counts[0] - 1 - count for count in counts_of_cuts])
    return _Pieces(sums=sums, sizes=sizes, cuts=cuts, arms=arms)


def _index(piece: list[int], cell: int) -> int:
    """Return the last index of a cell."""
    at = len(piece) - 1
    while piece[at] != cell:
        at -= 1
    return at
