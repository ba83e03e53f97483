from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foldback.planner.chain.chain import Chain
from foldback.planner.pathfinding.snake import is_box, snake_path
from foldback.planner.pathfinding.start_cell import parse_cell, starting_at
from foldback.planner.shapes.shape import Shape
from tests.planner.chains import chain_of
from tests.refusal import refused

RING = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [1, 1, 0], [0, 1, 0]]
HOOK = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 1, 1]]


def cells_of(chain: Chain) -> list[list[int]]:
    return np.rint(chain.folded_poses.positions).astype(int).tolist()


def test_ring_is_cut_anywhere() -> None:
    for x, y, z in RING:
        chain, reason = starting_at(chain_of(RING), (x, y, z))
        computed_cells_of = cells_of(chain)
        assert reason == ()
        assert computed_cells_of[0] == [x, y, z]
        assert sorted(computed_cells_of) == sorted(RING)


def test_open_path_begins_at_either_end() -> None:
    chain = chain_of(HOOK)
    assert starting_at(chain, None) == (chain, ())
    assert cells_of(starting_at(chain, (0, 0, 0))[0]) == HOOK
    assert cells_of(starting_at(chain, (0, 1, 1))[0]) == HOOK[::-1]
    start_chain, reason = starting_at(chain, (1, 1, 0))
    assert start_chain is chain
    assert [(r.code, r.values["cell"]) for r in reason] == [("given-cells", (1, 1, 0))]
    with refused("not-a-cell"):
        starting_at(chain, (5, 5, 5))


def test_cells_are_read_from_text() -> None:
    assert parse_cell(" 3, -1,12") == (3, -1, 12)
    for text in ("", "1,2", "1,2,3,4", "a,b,c", "1.5,0,0", "1,2,99999999"):
        with refused("bad-start"):
            parse_cell(text)


SIDES = st.tuples(st.integers(1, 6), st.integers(1, 6), st.integers(1, 6))


@given(sides=SIDES, axes=st.sampled_from(list(permutations((0, 1, 2)))))
def test_snake_visits_every_cell_of_a_box(
    sides: tuple[int, int, int], axes: tuple[int, int, int]
) -> None:
    path = snake_path(sides, axes=axes)
    assert (np.abs(np.diff(path, axis=0)).sum(axis=1) == 1).all()
    assert np.array_equal(np.unique(path, axis=0), np.argwhere(np.ones(sides, dtype=bool)))
    if sides[axes[0]] > 1:
        assert (path[1] - path[0]).tolist() == np.eye(3)[axes[0]].tolist()


@pytest.mark.parametrize(("hole", "box"), [(None, True), ((1, 1, 1), False), ((0, 0, 0), False)])
def test_is_box(hole: tuple[int, int, int] | None, box: bool) -> None:
    cells = [tuple(c) for c in (snake_path((3, 3, 3)) + 7).tolist()]
    if hole is not None:
        cells.remove(tuple(7 + v for v in hole))
    assert is_box(Shape.from_cells(cells)) is box
