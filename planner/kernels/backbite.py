"""Paths on a graph by turning their ends round, compiled.

The last cell of a path touches some earlier cell w. Turning round what follows w makes a path of
the same cells with another end (Pósa, 1976; "backbite" among those who study polymers).
"""
# pyright: reportUntypedFunctionDecorator=false, reportArgumentType=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL, ZERO

Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


@njit(**INNER)
def _turn(path: Ints, place: Ints, low: int, high: int) -> None:
    """Turns path[low … high] round."""
    while low < high:
        a = path[low]
        b = path[high]
        path[low] = b
        place[b] = low
        path[high] = a
        place[a] = high
        low += 1
        high -= 1
    if low == high:
        place[path[low]] = low


@njit(**INNER)
def _free(cell: int, near: Ints, place: Ints) -> int:
    """Return the number of a cell's neighbours that are not on the path."""
    count = 0
    for k in range(6):
        neighbour = near[cell, k]
        if neighbour >= 0 and place[neighbour] < 0:
            count += 1
    return count


@njit(**KERNEL)
def grow(near: Ints, ends: Flags, start: int, moves: int, seed: int) -> tuple[int, Ints]:
    """Grows a path by extending and turning its ends until it visits every cell.

    Args:
        near: (n, 6) neighbours of each cell, −1 where there is none.
        ends: (n,) cells that a complete path may begin and end with.
        start: The cell that it begins with, −1 for any.
        moves: How many moves at most.
        seed: Of the choices.

    Returns:
        How many cells are on the longest path found, and (n,) that path when it is complete and
        its ends may be ends; a complete one with other ends counts as one cell less.
    """
    np.random.seed(seed)
    n = near.shape[0]
    path = np.empty(n, dtype=np.int64)
    place = np.full(n, -1, dtype=np.int64)
    choice = np.empty(6, dtype=np.int64)
    length = 1
    path[0] = start if start >= 0 else np.random.randint(n)
    place[path[0]] = 0
    best = 1
    for _ in range(moves):
        if length == n and ends[path[0]] and ends[path[n - 1]]:
            return n, path
        if start < 0 and np.random.random() < 0.1:
            _turn(path, place, ZERO, length - 1)
        tail = path[length - 1]
        # Go on to the neighbour that has fewest ways on itself.
        fewest = 7
        free_count = 0
        for k in range(6):
            neighbour = near[tail, k]
            if neighbour >= 0 and place[neighbour] < 0:
                free = _free(neighbour, near, place)
                if free < fewest:
                    fewest = free
                    free_count = 0
                if free == fewest:
                    choice[free_count] = neighbour
                    free_count += 1
        if free_count > 0:
            neighbour = choice[np.random.randint(free_count)]
            path[length] = neighbour
            place[neighbour] = length
            length += 1
            best = max(best, min(length, n - 1))
            continue
        # Turn: rather so that the new end has somewhere to go.
        good = 0
        for k in range(6):
            neighbour = near[tail, k]
            if neighbour >= 0 and place[neighbour] < length - 2:
                if _free(path[place[neighbour] + 1], near, place) > 0:
                    if good == 0:
                        free_count = 0
                    good = 1
                    choice[free_count] = neighbour
                    free_count += 1
                elif good == 0:
                    choice[free_count] = neighbour
                    free_count += 1
        if free_count > 0 and (good == 1 or start >= 0 or np.random.random() < 0.9):
            _turn(path, place, place[choice[np.random.randint(free_count)]] + 1, length - 1)
        elif start < 0:
            _turn(path, place, ZERO, length - 1)
            if free_count == 0 and _stuck(path, length, near, place):
                return best, path
        else:
            return best, path
    return best, path


@njit(**INNER)
def _stuck(path: Ints, length: int, near: Ints, place: Ints) -> bool:
    """Return True if neither end of a path has a neighbour besides its own next cell."""
    for tail, inner in ((path[0], path[min(1, length - 1)]), (path[length - 1], path[length - 2])):
        for k in range(6):
            neighbour = near[tail, k]
            if neighbour >= 0 and neighbour != inner:
                return False
    return True


@njit(**INNER)
def _total(path: Ints, place: Ints, near: Ints) -> int:
    total = 0
    for cell in range(path.shape[0]):
        for k in range(0, 6, 2):
            if near[cell, k] >= 0:
                total += abs(place[cell] - place[near[cell, k]])
    return total


@njit(**KERNEL)
def ease(path: Ints, near: Ints, ends: Flags, start: int, moves: int, seed: int) -> Ints:
    """Brings cells that touch closer along a path, by turning its ends while that cools down.

    Args:
        path: (n,) a complete path.
        near: (n, 6) neighbours of each cell, −1 where there is none.
        ends: (n,) cells that it may begin and end with.
        start: The cell that it begins with, −1 for any.
        moves: How many turns are tried.
        seed: Of the choices.

    Returns:
        (n,) the path with the least sum of distances that was met, with ends that may be ends.
    """
    np.random.seed(seed)
    n = near.shape[0]
    path = path.copy()
    place = np.empty(n, dtype=np.int64)
    for k in range(n):
        place[path[k]] = k
    total = _total(path, place, near)
    best = total
    saved_path = path.copy()
    hot = 0.1 * total
    for move in range(moves):
        heat = hot * (1e-4 ** (move / moves))
        if start < 0 and np.random.random() < 0.5:
            _turn(path, place, ZERO, n - 1)
        tail = path[n - 1]
        neighbour = near[tail, np.random.randint(6)]
        if neighbour < 0 or place[neighbour] >= n - 2:
            continue
        low = place[neighbour] + 1
        _turn(path, place, low, n - 1)
        after = _total(path, place, near)
        if after > total and np.random.random() >= np.exp((total - after) / heat):
            _turn(path, place, low, n - 1)
            continue
        total = after
        if total < best and ends[path[0]] and ends[path[n - 1]]:
            best = total
            saved_path[:] = path
    return saved_path
