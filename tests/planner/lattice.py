"""Random walks on the lattice and its rotations, for property tests."""

from itertools import permutations, product

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

NEIGHBOURS = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))


def box(*sides: int) -> list[tuple[int, ...]]:
    """Return the cells of a box."""
    return list(product(*map(range, sides)))


def walk(turns: list[int]) -> NDArray[np.int64]:
    """Return a self-avoiding walk: each turn picks a free neighbour, until none is left."""
    cells = [(0, 0, 0)]
    for turn in turns:
        x, y, z = cells[-1]
        free = [c for a, b, c_ in NEIGHBOURS if (c := (x + a, y + b, z + c_)) not in cells]
        if not free:
            break
        cells.append(free[turn % len(free)])
    return np.array(cells, dtype=np.int64)


def walks(*, most: int = 40) -> st.SearchStrategy[NDArray[np.int64]]:
    """Return a strategy for self-avoiding lattice walks of three or more cells."""
    return st.lists(st.integers(0, 5), min_size=2, max_size=most).map(walk)


def _rotations() -> list[NDArray[np.int64]]:
    found: list[NDArray[np.int64]] = []
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        matrix = np.zeros((3, 3), dtype=np.int64)
        matrix[range(3), order] = signs
        if np.linalg.det(matrix) > 0:
            found.append(matrix)
    return found


ROTATIONS = _rotations()
"""24 rotations that map the lattice to itself."""
