"""Random walks and sets of cells on the lattice, for property tests."""

from itertools import product

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

Ints = NDArray[np.int64]
NEIGHBOURS = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))


def box(*sides: int) -> list[tuple[int, ...]]:
    """Return the cells of a box."""
    return list(product(*map(range, sides)))


def box_array(*sides: int) -> Ints:
    """Return the (n, 3) cells of a box."""
    return np.array(box(*sides))


def walk(turns: list[int]) -> Ints:
    """Return a self-avoiding walk: each turn picks a free neighbour, until none is left."""
    cells = [(0, 0, 0)]
    for turn in turns:
        x, y, z = cells[-1]
        free = [c for a, b, c_ in NEIGHBOURS if (c := (x + a, y + b, z + c_)) not in cells]
        if not free:
            break
        cells.append(free[turn % len(free)])
    return np.array(cells, dtype=np.int64)


def walks(*, maximum: int = 40) -> st.SearchStrategy[Ints]:
    """Return a strategy for self-avoiding lattice walks of three or more cells."""
    return st.lists(st.integers(0, 5), min_size=2, max_size=maximum).map(walk)


def connected_sets(maximum: int = 40) -> st.SearchStrategy[Ints]:
    """Return a strategy for connected sets of cells: each new one is adjacent to an earlier one."""
    picks = st.tuples(st.integers(0, maximum), st.integers(0, 5))
    return st.lists(picks, max_size=maximum).map(grow)


def grow(picks: list[tuple[int, int]]) -> Ints:
    """Return cells, each adjacent to an earlier one; repeated cells are omitted."""
    cells = [(0, 0, 0)]
    for picked_cells, side in picks:
        x, y, z = cells[picked_cells % len(cells)]
        a, b, c = NEIGHBOURS[side]
        if (x + a, y + b, z + c) not in cells:
            cells.append((x + a, y + b, z + c))
    return np.array(cells, dtype=np.int64)
