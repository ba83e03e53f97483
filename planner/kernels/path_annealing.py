"""Annealing of a self-avoiding lattice path towards a solid, compiled.

A state is one path. Local moves lengthen it, shorten it, flip its corners, move its ends and
exchange its stretches. A worse path is accepted as in simulated annealing (Metropolis et al.,
1953). The energy is −N · IoU with IoU = S / (V + n − S): n cells, which together contain the volume
S of a solid with the volume V, all in cells; N is the requested number.

All sums are integers, the random numbers are a 48-bit linear congruence, and the thresholds of
acceptance are a table: a seed gives the same path on every machine.
"""
# pyright: reportUntypedFunctionDecorator=false, reportArgumentType=false

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL, ZERO

Ints = NDArray[np.int64]
Array = NDArray[np.float64]

FULL: Final = 4096
"""Fill of a cell that is wholly inside the solid; the unit of fills and costs is 1/4096 cell."""
CLOSED: Final = -1
"""Fill of a cell that no path may enter."""
_FREE: Final = -1
_SHUT: Final = -2

DETOUR, CUT, CORNER, GROW, RETRACT, SLITHER, BACKBITE, PARALLEL = range(8)
MOVES: Final = 8
"""Number of kinds of moves."""

_HEAD, _TAIL, _COUNT, _SHARED, _COST = range(5)
RANDOM: Final = 5
"""Place of the state of the random numbers in the sums of a state."""
_BARE: Final[dict[str, Any]] = INNER | {"_nrt": False}
"""Options of a kernel that creates no arrays. Their references are then not counted, which would
take six times as long as the moves."""
_INLINED: Final[dict[str, Any]] = _BARE | {"inline": "always"}
"""Options of a move, which is inlined: calls make an annealing take half as long again."""
_MULTIPLIER: Final = 0x5DEECE66D
_MASK: Final = (1 << 48) - 1


class Field(NamedTuple):
    """Cells that a path may use, and its goal.

    Attributes:
        fill: (m,) fill of each cell of a flat grid, 0…``FULL``, or ``CLOSED``; its rim is closed.
        cost: (m,) further energy of a path through each cell, in 1/``FULL`` cells.
        steps: (6,) differences of the flat indices of neighbours; k and k ^ 1 are opposite.
        volume: Volume of the solid, in cells.
        target: Requested number of cells, N.
        low, high: Smallest number, which is soft, and largest number of cells.
    """

    fill: Ints
    cost: Ints
    steps: Ints
    volume: float
    target: float
    low: int
    high: int


class Schedule(NamedTuple):
    """Moves of an annealing.

    Attributes:
        moves: Number of moves.
        hot: First temperature, in cells.
        cooling: Factor of the temperature after each 256 moves.
        thresholds: (1024,) exponentially distributed numbers, −ln u.
        kinds: (256,) kinds of moves, each as often as it is tried.
    """

    moves: int
    hot: float
    cooling: float
    thresholds: Array
    kinds: Ints


class _Links(NamedTuple):
    """Path: next and previous cell of each cell, its cells in any order, and the sums."""

    after: Ints
    before: Ints
    slot: Ints
    cells: Ints
    sums: Ints


@njit(**_BARE)
def draw(sums: Ints, count: int) -> int:
    """Return a random number below ``count``, which is at most 2¹⁶."""
    sums[RANDOM] = (int(sums[RANDOM]) * _MULTIPLIER + 0xB) & _MASK
    return ((int(sums[RANDOM]) >> 17) * count) >> 31


@njit(**_BARE)
def energy_of(field: Field, count: int, shared: int, cost: int) -> float:
    """Return the energy of ``count`` cells; ``shared`` and ``cost`` in 1/``FULL`` cells."""
    union = (field.volume + count) * FULL - shared
    energy = cost / FULL - field.target * shared / union
    if count < field.low:
        energy += 0.6 * (field.low - count)  # more than a cell that helps is worth
    return energy


@njit(**_BARE)
def _accepts(field: Field, path: _Links, count: int, fill: int, cost: int, limit: float) -> bool:
    """Change the sums if a change of the path is accepted."""
    sums = path.sums
    n = sums[_COUNT] + count
    if n > field.high or n < 2:
        return False
    old = energy_of(field, sums[_COUNT], sums[_SHARED], sums[_COST])
    new = energy_of(field, n, sums[_SHARED] + fill, sums[_COST] + cost)
    if new - old > limit:
        return False
    sums[_SHARED] += fill
    sums[_COST] += cost
    return True


@njit(**_BARE)
def _join(path: _Links, a: int, b: int) -> None:
    path.after[a] = b
    path.before[b] = a


@njit(**_BARE)
def _enter(path: _Links, cell: int) -> None:
    n = path.sums[_COUNT]
    path.slot[cell] = n
    path.cells[n] = cell
    path.sums[_COUNT] = n + 1


@njit(**_BARE)
def _leave(path: _Links, cell: int) -> None:
    n = path.sums[_COUNT] - 1
    last = path.cells[n]
    path.cells[path.slot[cell]] = last
    path.slot[last] = path.slot[cell]
    path.slot[cell] = _FREE
    path.after[cell] = _FREE
    path.before[cell] = _FREE
    path.sums[_COUNT] = n


@njit(**_BARE)
def _reverse(path: _Links, first: int, last: int) -> None:
    """Reverse the stretch from ``first`` to ``last``, and its links to the rest."""
    after, before = path.after, path.before
    left = before[first]
    right = after[last]
    at = first
    while True:
        following = after[at]
        after[at] = before[at]
        before[at] = following
        if at == last:
            break
        at = following
    before[last] = left
    after[first] = right
    if left >= 0:
        after[left] = last
    if right >= 0:
        before[right] = first


@njit(**_INLINED)
def _detour(field: Field, path: _Links, limit: float) -> bool:
    """Replace a step a b by a c d b, beside it."""
    a = path.cells[draw(path.sums, path.sums[_COUNT])]
    b = path.after[a]
    step = field.steps[draw(path.sums, 6)]
    if b < 0:
        return False
    c = a + step
    d = b + step
    if path.slot[c] != _FREE or path.slot[d] != _FREE:
        return False
    fill = field.fill[c] + field.fill[d]
    cost = field.cost[c] + field.cost[d]
    if not _accepts(field, path, 2, fill, cost, limit):
        return False
    _join(path, a, c)
    _join(path, c, d)
    _join(path, d, b)
    _enter(path, c)
    _enter(path, d)
    return True


@njit(**_INLINED)
def _cut(field: Field, path: _Links, limit: float) -> bool:
    """Replace a bay a c d b by the step a b: the inverse of a detour."""
    a = path.cells[draw(path.sums, path.sums[_COUNT])]
    c = path.after[a]
    if c < 0:
        return False
    d = path.after[c]
    if d < 0:
        return False
    b = path.after[d]
    if b < 0 or c - a != d - b:
        return False
    fill = -field.fill[c] - field.fill[d]
    cost = -field.cost[c] - field.cost[d]
    if not _accepts(field, path, -2, fill, cost, limit):
        return False
    _join(path, a, b)
    _leave(path, c)
    _leave(path, d)
    return True


@njit(**_INLINED)
def _corner(field: Field, path: _Links, limit: float) -> bool:
    """Flip a corner a b d to the opposite corner of its square, a c d."""
    a = path.cells[draw(path.sums, path.sums[_COUNT])]
    b = path.after[a]
    if b < 0:
        return False
    d = path.after[b]
    if d < 0 or b - a == d - b:
        return False
    c = a + d - b
    if path.slot[c] != _FREE:
        return False
    fill = field.fill[c] - field.fill[b]
    if not _accepts(field, path, 0, fill, field.cost[c] - field.cost[b], limit):
        return False
    _join(path, a, c)
    _join(path, c, d)
    _leave(path, b)
    _enter(path, c)
    return True


@njit(**_BARE)
def _lengthen(path: _Links, at_tail: bool, cell: int) -> None:
    if at_tail:
        _join(path, path.sums[_TAIL], cell)
        path.sums[_TAIL] = cell
    else:
        _join(path, cell, path.sums[_HEAD])
        path.sums[_HEAD] = cell
    _enter(path, cell)


@njit(**_BARE)
def _shorten(path: _Links, at_tail: bool) -> None:
    if at_tail:
        end = path.sums[_TAIL]
        path.sums[_TAIL] = path.before[end]
        path.after[path.before[end]] = _FREE
    else:
        end = path.sums[_HEAD]
        path.sums[_HEAD] = path.after[end]
        path.before[path.after[end]] = _FREE
    _leave(path, end)


@njit(**_INLINED)
def _move_ends(field: Field, path: _Links, kind: int, limit: float) -> bool:
    """Let an end grow, retract, or grow while the other end retracts (slither)."""
    at_tail = draw(path.sums, 2) == 1
    count = ZERO
    fill = ZERO
    cost = ZERO
    cell = ZERO
    if kind != RETRACT:
        cell = path.sums[_TAIL if at_tail else _HEAD] + field.steps[draw(path.sums, 6)]
        if path.slot[cell] != _FREE:
            return False
        count += 1
        fill += field.fill[cell]
        cost += field.cost[cell]
    if kind != GROW:
        at_end = path.sums[_TAIL if at_tail == (kind == RETRACT) else _HEAD]
        count -= 1
        fill -= field.fill[at_end]
        cost -= field.cost[at_end]
    if not _accepts(field, path, count, fill, cost, limit):
        return False
    if kind == RETRACT:
        _shorten(path, at_tail)
        return True
    if kind == SLITHER:
        _shorten(path, not at_tail)
    _lengthen(path, at_tail, cell)
    return True


@njit(**_INLINED)
def _backbite(field: Field, path: _Links) -> bool:
    """Link an end to a neighbour on the path, and cut there: the same cells with another end."""
    at_tail = draw(path.sums, 2) == 1
    end = path.sums[_TAIL if at_tail else _HEAD]
    neighbour = end + field.steps[draw(path.sums, 6)]
    if path.slot[neighbour] < 0 or neighbour == path.before[end] or neighbour == path.after[end]:
        return False
    if at_tail:
        new = path.after[neighbour]
        _reverse(path, new, end)
        path.sums[_TAIL] = new
    else:
        new = path.before[neighbour]
        _reverse(path, end, new)
        path.sums[_HEAD] = new
    return True


@njit(**_INLINED)
def _exchange(field: Field, path: _Links) -> bool:
    """Exchange two steps a b and c d side by side for a c and b d: the stretch between reverses."""
    a = path.cells[draw(path.sums, path.sums[_COUNT])]
    b = path.after[a]
    step = field.steps[draw(path.sums, 6)]
    if b < 0:
        return False
    c = a + step
    d = b + step
    if path.slot[c] < 0 or path.slot[d] < 0 or path.after[c] != d:
        return False
    at = b
    while at >= 0 and at != c:
        at = path.after[at]
    if at == c:
        _reverse(path, b, c)
    else:
        _reverse(path, d, a)
    return True


@njit(**_INLINED)
def _changed(field: Field, path: _Links, kind: int, limit: float) -> bool:
    """Try a move; return True if it changed the path."""
    if kind == DETOUR:
        return _detour(field, path, limit)
    if kind == CUT:
        return _cut(field, path, limit)
    if kind == CORNER:
        return _corner(field, path, limit)
    if kind == BACKBITE:
        return _backbite(field, path)
    if kind == PARALLEL:
        return _exchange(field, path)
    return _move_ends(field, path, kind, limit)


@njit(**_BARE)
def _rises(path: _Links) -> bool:
    """Return True if a path never descends, begins flat and never turns back above itself."""
    at = path.sums[_HEAD]
    flat = ZERO
    climbing = False
    first = True
    while path.after[at] >= 0:
        link = path.after[at] - at
        if link == -1 or (first and link == 1):
            return False
        if link != 1:
            if climbing and link == -flat:
                return False
            flat = link
        climbing = link == 1
        first = False
        at = path.after[at]
    return True


@njit(**_BARE)
def _store(path: _Links, order: Ints) -> None:
    """Write the cells in the order of the path."""
    at = path.sums[_HEAD]
    for i in range(path.sums[_COUNT]):
        order[i] = at
        at = path.after[at]


@njit(**_BARE)
def _load(field: Field, path: _Links, order: Ints, count: int) -> None:
    """Replace the path by ``count`` cells in their order."""
    sums = path.sums
    for i in range(sums[_COUNT]):
        cell = path.cells[i]
        path.slot[cell] = _FREE
        path.after[cell] = _FREE
        path.before[cell] = _FREE
    for k in range(RANDOM):
        sums[k] = 0
    for i in range(count):
        cell = order[i]
        _enter(path, cell)
        sums[_SHARED] += field.fill[cell]
        sums[_COST] += field.cost[cell]
        if i:
            _join(path, order[i - 1], cell)
    sums[_HEAD] = order[0]
    sums[_TAIL] = order[count - 1]


@njit(**KERNEL)
def anneal(
    field: Field, schedule: Schedule, start: Ints, seed: int, rises: bool
) -> tuple[Ints, float, Ints]:
    """Anneal a path.

    Args:
        field: The cells and the goal.
        schedule: The moves.
        start: (s,) flat indices of the first path, at least 2 and at most ``field.high`` cells.
        seed: Random seed, 0…2⁴⁸ − 1.
        rises: True if every path shall keep the rules of paths that rise (``_rises``), along the
            last axis; ``start`` must keep them.

    Returns:
        (n,) flat indices of the best path, its energy, and (``MOVES``,) numbers of accepted moves.
    """
    m = field.fill.shape[0]
    room = field.high + 2
    path = _Links(
        np.full(m, _FREE, dtype=np.int64),
        np.full(m, _FREE, dtype=np.int64),
        np.full(m, _FREE, dtype=np.int64),
        np.empty(room, dtype=np.int64),
        np.zeros(6, dtype=np.int64),
    )
    for i in range(m):
        if field.fill[i] < 0:
            path.slot[i] = _SHUT
    _load(field, path, start, start.shape[0])
    path.sums[RANDOM] = (seed ^ _MULTIPLIER) & _MASK
    accepted = np.zeros(MOVES, dtype=np.int64)
    orders = np.empty((2, room), dtype=np.int64)
    best, count = _walk(field, schedule, path, rises, accepted, orders[0], orders[1])
    return orders[0, :count].copy(), best, accepted


@njit(**_BARE)
def _walk(
    field: Field,
    schedule: Schedule,
    path: _Links,
    rises: bool,
    accepted: Ints,
    best_order: Ints,
    last_order: Ints,
) -> tuple[float, int]:
    best = np.inf
    best_count = ZERO
    last_count = path.sums[_COUNT]
    _store(path, last_order)
    temperature = schedule.hot
    for turn in range(schedule.moves):
        if turn % 256 == 255:
            temperature *= schedule.cooling
        kind = schedule.kinds[draw(path.sums, 256)]
        limit = temperature * schedule.thresholds[draw(path.sums, 1024)]
        if not _changed(field, path, kind, limit):
            continue
        if rises:
            if not _rises(path):
                _load(field, path, last_order, last_count)
                continue
            _store(path, last_order)
            last_count = path.sums[_COUNT]
        accepted[kind] += 1
        if 3 * turn < schedule.moves:  # hot in the first third
            continue
        energy = energy_of(field, path.sums[_COUNT], path.sums[_SHARED], path.sums[_COST])
        if energy < best - 1e-9:
            best = energy
            best_count = path.sums[_COUNT]
            _store(path, best_order)
    if best_count == 0:
        best = energy_of(field, path.sums[_COUNT], path.sums[_SHARED], path.sums[_COST])
        best_count = path.sums[_COUNT]
        _store(path, best_order)
    return best, best_count
