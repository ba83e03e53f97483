from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foldback.planner.pathfinding.block_merging import (
    FACES,
    Tree,
    block_cycle,
    block_path,
    halved,
    joint_options,
)
from foldback.planner.pathfinding.knots import knot_of
from foldback.planner.pathfinding.lattice import spread, spreads_of_cuts, surface
from foldback.planner.pathfinding.loose_block_merging import block_corners, loose_block_path
from foldback.planner.shapes.shape import Shape
from tests.conftest import examples
from tests.planner.lattice import Ints, connected_sets

TREES: tuple[Tree, ...] = ("bfs", "dfs", "random")


def is_path_through(path: Ints, cells: Ints) -> bool:
    steps = np.abs(np.diff(path, axis=0)).sum(axis=1)
    return bool((steps == 1).all()) and np.array_equal(
        path[np.lexsort(path.T[::-1])], cells[np.lexsort(cells.T[::-1])]
    )


def double(coarse: Ints) -> Ints:
    corners = np.array(list(product((0, 1), repeat=3)))
    return (2 * coarse[:, None, :] + corners).reshape(-1, 3)


@given(coarse=connected_sets(), seed=st.integers(0, 99), tree=st.sampled_from(TREES))
def test_block_path_of_connected_sets(coarse: Ints, seed: int, tree: Tree) -> None:
    path = block_path(coarse, np.random.default_rng(seed), tree=tree)
    assert is_path_through(path, double(coarse))
    assert np.abs(path[0] - path[-1]).sum() == 1
    assert surface(path)[[0, -1]].all()


def test_blocks_can_be_joined_by_every_face_and_edge() -> None:
    # This proves that block merging succeeds: for each edge of each face by which a block is joined
    # there is a cycle with that edge and a different edge in each of the other faces.
    options = joint_options()
    of_faces = {
        (face, edge)
        for face, (axis, side) in enumerate(FACES)
        for edge in ((a, b) for a in range(8) for b in (a | 1, a | 2, a | 4) if a < b)
        if all((corner >> (2 - axis)) & 1 == side for corner in edge)
    }
    assert set(options) == of_faces and len(of_faces) == 24
    for (face, edge), edge_options in options.items():
        for links, edges in edge_options:
            assert edges[face] == edge and len(set(edges)) == 6
            assert all(second in links[corner] for corner, second in edges)


def test_block_cycle_is_not_knotted() -> None:
    coarse = np.argwhere(np.ones((3, 3, 3), dtype=bool))
    for tree in TREES:
        cycle = block_cycle(coarse, np.random.default_rng(5), tree=tree)
        assert knot_of(cycle, closed=True).verdict == "unknot"


@pytest.mark.slow
@given(coarse=connected_sets(maximum=8), seed=st.integers(0, 9))
@examples(one_of=3)
def test_spreads_of_cuts_are_those_of_their_paths(coarse: Ints, seed: int) -> None:
    cycle = block_cycle(coarse, np.random.default_rng(seed))
    cuts = [spread(np.roll(cycle, -k, axis=0)) for k in range(len(cycle))]
    assert np.allclose(spreads_of_cuts(cycle), cuts)


@given(coarse=connected_sets(maximum=10), shift=st.tuples(*[st.integers(-3, 3)] * 3))
def test_doubled_shape_is_halved(coarse: Ints, shift: tuple[int, int, int]) -> None:
    computed_halved = halved(Shape.from_cells(double(coarse) + np.array(shift)))
    assert np.array_equal(
        computed_halved - computed_halved.min(axis=0),
        np.unique(coarse - coarse.min(axis=0), axis=0),
    )


def test_other_shapes_are_not_halved() -> None:
    line = [(x, 0, 0) for x in range(8)]
    assert halved(Shape.from_cells(line)) is None
    bent = np.concatenate(
        [double(np.array([(0, 0, 0)])), double(np.array([(1, 0, 0)])) + (0, 1, 0)]
    )
    assert halved(Shape.from_cells(bent)) is None


def test_blocks_off_the_grid_are_merged() -> None:
    lower, upper = double(np.array([(0, 0, 0), (1, 0, 0)])), double(np.array([(0, 0, 1)]))
    cells = np.concatenate([lower, upper + (1, 0, 0)])
    shape = frozenset((x, y, z) for x, y, z in cells.tolist())
    assert block_corners(shape) == [(0, 0, 0), (2, 0, 0), (1, 0, 2)]
    loose_block_paths = [loose_block_path(shape, np.random.default_rng(seed)) for seed in range(5)]
    assert any(path is not None for path in loose_block_paths)
    assert all(is_path_through(path, cells) for path in loose_block_paths if path is not None)
    assert block_corners(frozenset({(0, 0, 0), (1, 0, 0)})) is None
