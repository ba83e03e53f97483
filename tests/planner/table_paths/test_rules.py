from itertools import product
from typing import Any

import numpy as np
import pytest

from foldback.planner.errors import InputError
from foldback.planner.table_paths.base_sides import prefix_margins, sides_of, stands
from foldback.planner.table_paths.layer import Layer, Work, ways
from foldback.planner.table_paths.rules import rule_violations
from foldback.planner.table_paths.score import WEIGHTS, Parts, levers, parts_of
from tests.case import case
from tests.planner.lattice import Ints, box_array


def path(start: tuple[int, int, int], steps: str) -> Ints:
    """Return a path by its steps: e and w along x, n and s along y, u and d along z."""
    moves = {"e": (1, 0, 0), "w": (-1, 0, 0), "n": (0, 1, 0), "s": (0, -1, 0)}
    moves |= {"u": (0, 0, 1), "d": (0, 0, -1)}
    return np.cumsum([start, *(moves[step] for step in steps)], axis=0)


def test_faults_of_paths() -> None:
    for steps, rule, codes in (
        ("eenwwuse", "layers", []),
        ("eenwwuse", "falls", []),
        ("ue", "layers", ["first-link"]),
        ("eeuww", "layers", ["hairpin"]),  # folds back above itself
        ("eeuuww", "layers", ["hairpin"]),  # also after two upward links
        ("eeuunwsw", "layers", []),
        ("enwuse", "layers", []),
        ("eeueeee", "layers", ["not-stable"]),
        ("ennuwd", "layers", ["goes-down"]),
        ("ennuwd", "falls", []),  # descends beside standing modules
        ("eennwwsued", "falls", ["boxed-in"]),
    ):
        with case((steps, rule)):
            faults = rule_violations(path((5, 5, 2), steps), rule=rule)
            assert [fault.code for fault in faults] == codes
            assert all(fault.cells and fault.reason.text for fault in faults)


def test_cells_that_are_no_path_are_refused() -> None:
    with pytest.raises(InputError, match="share a face"):
        rule_violations([(0, 0, 0), (1, 0, 0), (3, 0, 0)])


def test_different_base_sides_of_boxes() -> None:
    assert [side.down for side in sides_of(box_array(2, 2, 2))] == ["-z"]
    assert len(list(sides_of(box_array(2, 3, 4)))) == 3
    wedge = np.concatenate([box_array(3, 2, 1), np.array([(0, 0, 1)])])
    assert len(list(sides_of(wedge))) == 6
    for side in sides_of(wedge):
        assert np.linalg.det(side.turn) == pytest.approx(1.0)
        assert np.array_equal(wedge @ side.turn.T + side.shift, side.cells)
        assert side.cells.min(axis=0).tolist() == [0, 0, 0]


def test_margins_to_the_rim_of_the_base() -> None:
    assert stands(path((0, 0, 0), "eee")) == pytest.approx(0.5)
    assert stands(path((0, 0, 0), "uuu")) == pytest.approx(0.5)
    # One cell on the floor and k beside above it: the mean of 0, 0, 1, 2 is 0.75, 0.25 beyond the
    # rim.
    assert stands(path((0, 0, 0), "uee")) == pytest.approx(-0.25)
    assert prefix_margins(path((0, 0, 0), "uee")) == pytest.approx([0.5, 0.5, 1 / 6, -0.25])


def some_ways(layer: Layer, maximum: int, work: Work) -> list[Any]:
    random = np.random.default_rng(maximum)
    return list(ways(layer, layer.bits, layer.whole, random, max_ways=maximum, work=work))


def test_all_ways_through_a_small_layer_are_found() -> None:
    cells = np.array(list(product(range(3), range(3))))
    layer = Layer(cells=cells, index=np.arange(9))
    layer_ways = some_ways(layer, 1, Work(10**6))
    # The 3×3 grid has twenty Hamiltonian paths, each of them in two directions.
    assert len(layer_ways) == len(set(layer_ways)) == 40


def test_ways_through_a_large_layer_are_limited() -> None:
    cells = np.array(list(product(range(6), range(7))))
    layer = Layer(cells=cells, index=np.arange(42))
    for limit in (100, 10**5):
        work = Work(limit)
        layer_ways = some_ways(layer, 10, work)
        assert (len(layer_ways) == 10) == (limit > 100)
        assert work.remaining >= -1
    for way in layer_ways:
        order = cells[[layer.cell_at[bit] for bit in way]]
        assert (np.abs(np.diff(order, axis=0)).sum(axis=1) == 1).all()
        assert len(set(way)) == 42


def test_parts_of_the_score() -> None:
    straight = parts_of(path((0, 0, 0), "eeee"))
    assert straight == Parts(front=1.0)
    assert straight.times(WEIGHTS) == pytest.approx(WEIGHTS.front)
    # An inward spiral: its last cell is enclosed.
    spiral = path((0, 0, 0), "eennwwse")
    parts = parts_of(spiral)
    assert parts.enclosed == pytest.approx(1 / 9)
    assert parts.end == pytest.approx(1 / 4)
    assert parts.bends == pytest.approx(4 / 7)
    assert parts_of(spiral[::-1]).enclosed == 0.0
    raised = parts_of(path((0, 0, 0), "eeuuww"))
    assert raised.fall == pytest.approx((1 + 2 + 2 + 2) / 7)
    assert levers(path((0, 0, 0), "eeuwwww")).tolist() == [0, 0, 0, 0, 0, 0, 1, 2]
