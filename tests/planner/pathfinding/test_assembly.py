"""Paths in assembly order: they visit every cell once and can be peeled from their far end."""

import numpy as np
import pytest

from foldback.planner.chain.path import Path
from foldback.planner.pathfinding.assembly import (
    assembly_path,
    from_better_end,
    layered_snake,
    solid_paths,
)
from foldback.planner.pathfinding.removal_analysis import analyse_removal
from foldback.planner.pathfinding.snake import snake_path
from foldback.planner.shapes.layered_path import layered_path
from tests.planner.lattice import Ints, box_array


def cup() -> Ints:
    cells = box_array(6, 6, 6)
    inner = ((cells[:, :2] >= 2) & (cells[:, :2] <= 3)).all(axis=1) & (cells[:, 2] >= 2)
    return cells[~inner]


def table() -> Ints:
    cells = box_array(8, 8, 6)
    legs = ((cells[:, :2] < 2) | (cells[:, :2] >= 6)).all(axis=1)
    return cells[legs | (cells[:, 2] >= 4)]


def ball(width: int) -> Ints:
    cells = box_array(width, width, width)
    return cells[((cells - 0.5 * (width - 1)) ** 2).sum(axis=1) <= 0.25 * width**2]


def plus() -> Ints:
    return np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])


def cells_of(blocks: Ints, side: int) -> Ints:
    return np.unique((side * blocks[:, None] + box_array(side, side, side)).reshape(-1, 3), axis=0)


@pytest.mark.parametrize("side", [2, 4])
@pytest.mark.parametrize("shape", [box_array(3, 3, 3), cup(), table()])
def test_path_visits_every_cell_and_each_block_can_be_removed_in_its_turn(
    shape: Ints, side: int
) -> None:
    path = assembly_path(shape, np.random.default_rng(1), side=side)
    assert path is not None
    Path.from_cells(path)
    np.testing.assert_array_equal(np.unique(path, axis=0), cells_of(shape, side))
    visited = path // side
    assert (np.diff(visited, axis=0) != 0).any(axis=1).sum() == len(shape) - 1
    assert analyse_removal(path, side**3).free


@pytest.mark.parametrize("shape", [box_array(4, 4, 4), table(), ball(6), plus()])
def test_path_by_layers_can_be_peeled(shape: Ints) -> None:
    path = max(
        solid_paths(shape, np.random.default_rng(0), 2), key=lambda p: analyse_removal(p).score
    )
    Path.from_cells(path)
    np.testing.assert_array_equal(np.unique(path, axis=0), cells_of(shape, 2))
    assert analyse_removal(path).score == 1.0
    steps = np.diff(path, axis=0)
    assert ((steps >= 0).all(axis=0) | (steps <= 0).all(axis=0)).any()  # one layer above the other


def test_layers_in_parts_have_no_path() -> None:
    rng = np.random.default_rng(0)
    assert layered_path(table(), 2, rng) is None  # four legs
    assert layered_path(table(), 0, rng) is not None
    assert layered_path(np.array([[0, 0, 0], [0, 0, 2]]), 2, rng) is None
    steps = np.array(
        [[x, 0, z] for z in range(4) for x in (3 * z, 3 * z + 1, 3 * z + 2, 3 * z + 3)]
    )
    assert layered_path(steps, 2, rng) is None


def test_pit_has_a_low_score() -> None:
    # A handle on a head: placed last it leaves a hole, four cells deep, for the group before it.
    head = box_array(4, 4, 4) * np.array([1, 1, 1])
    hole = (head[:, 0] == 3) & (head[:, 1] == 1) & (head[:, 2] == 1)
    core = cells_of_blocks(head[~hole])
    pit = cells_of_blocks(head[hole])
    rated = analyse_removal(np.concatenate([core, pit]), 32)
    assert rated.free and rated.score < 0.7
    assert rated.ways[0] == 1


def cells_of_blocks(blocks: Ints) -> Ints:
    """Return the cells of blocks in any order; they need not form a path to test removal."""
    return (4 * blocks[:, None] + box_array(4, 4, 4)).reshape(-1, 3)


def test_path_by_layers_of_a_ring_leaves_all_ways_open() -> None:
    ring = box_array(10, 10, 2)
    ring = ring[~((ring[:, :2] >= 3) & (ring[:, :2] <= 6)).all(axis=1)]
    path = layered_path(ring, 2, np.random.default_rng(0))
    assert path is not None
    # From the highest layer: straight up, and diagonally up to all eight sides.
    assert analyse_removal(path).ways.min() >= 9


def test_path_is_peeled_from_its_better_end() -> None:
    inward = buried()
    Path.from_cells(inward)
    removal_analysis = analyse_removal(inward, 1)
    assert (
        not removal_analysis.free
        and removal_analysis.score < analyse_removal(inward[::-1], 1).score
    )
    assert removal_analysis.buried.tolist() == [0]
    rating = [analyse_removal(path).score for path in (inward, from_better_end(inward))]
    assert rating[1] >= rating[0]
    snake = layered_snake((6, 8, 6))
    assert from_better_end(snake) is snake


def test_halved_blocks_may_have_a_path_if_blocks_have_none() -> None:
    # Four arms on one block: at least three of them would have to be an end of the path.
    cross = plus()
    assert assembly_path(cross, np.random.default_rng(0), side=4) is None
    path = next(solid_paths(cross, np.random.default_rng(0), 4))
    Path.from_cells(path)
    np.testing.assert_array_equal(np.unique(path, axis=0), cells_of(cross, 4))
    # Six arms along three axes: no axis has connected layers.
    legs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    frame = np.unique(np.concatenate([legs, plus(), [[0, 0, 1], [0, 0, -1]]]), axis=0)
    assert not list(solid_paths(frame, np.random.default_rng(0), 2))


def test_layered_snake_can_be_peeled() -> None:
    assert analyse_removal(layered_snake((6, 8, 6)), 24).free
    np.testing.assert_array_equal(layered_snake((4, 2, 3)), snake_path((4, 2, 3), axes=(1, 2, 0)))


def buried() -> Ints:
    """Return a path through a box, except for one corner, whose far end is its centre."""
    ring = [(2, 2), (2, 1), (2, 0), (1, 0), (0, 0), (0, 1), (0, 2), (1, 2)]
    top = [(1, 2), (2, 2), (2, 1), (2, 0), (1, 0), (0, 0), (0, 1), (1, 1)]
    return np.array(
        [
            *snake_path((3, 3, 1)).tolist(),
            *[(x, y, 1) for x, y in ring],
            *[(x, y, 2) for x, y in top],
            (1, 1, 1),
        ]
    )
