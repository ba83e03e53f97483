from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path as FilePath

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from bench.feasible_sets import FeasibleSet, feasible_sets
from bench.hard_sets import hard_sets
from bench.paths import HARD_RESULTS, RESULTS, check_stored
from planner.chain.path import Path
from planner.errors import InputError
from planner.pathfinding.circuit_solver import CircuitSolver
from planner.pathfinding.exact import exact_path
from planner.pathfinding.infeasibility import obstacles
from planner.pathfinding.lattice import neighbours, spread, surface
from planner.pathfinding.sat_paths import circuit
from planner.shapes.shape import Shape
from tests.conftest import examples
from tests.planner.lattice import walks

Ints = NDArray[np.int64]


def box(*sides: int) -> list[tuple[int, ...]]:
    return list(product(*map(range, sides)))


def check(found: Ints | None, cells: Ints) -> None:
    assert found is not None
    assert (np.abs(np.diff(found, axis=0)).sum(axis=1) == 1).all()
    assert np.array_equal(np.unique(found, axis=0), cells)
    assert len(found) == len(cells)


def has_path(cells: Ints) -> bool:
    """By trying everything: for a handful of cells."""
    near = [[k for k in row if k >= 0] for row in neighbours(cells).tolist()]

    def goes_on(cell: int, left: frozenset[int]) -> bool:
        return not left or any(goes_on(k, left - {k}) for k in near[cell] if k in left)

    everything = frozenset(range(len(cells)))
    return any(goes_on(k, everything - {k}) for k in everything)


small_sets = st.sets(
    st.tuples(st.integers(0, 3), st.integers(0, 2), st.integers(0, 1)), min_size=3, max_size=11
)


@pytest.mark.slow
@given(cells=small_sets)
def test_the_search_agrees_with_trying_everything(cells: set[tuple[int, int, int]]) -> None:
    shape = Shape.from_cells(sorted(cells))
    search = exact_path(shape)
    assert search.status == ("found" if has_path(shape.cells) else "infeasible")
    if search.status == "found":
        check(search.cells, shape.cells)
    if obstacles(shape.cells):
        assert not has_path(shape.cells)


@given(walk=walks(most=120), seed=st.integers(0, 99))
def test_cells_of_a_walk_have_a_path_and_it_is_found(walk: Ints, seed: int) -> None:
    shape = Shape.from_cells(walk)
    if len(shape) >= 3:
        check(exact_path(shape, seed=seed).cells, shape.cells)


@given(walk=walks(most=60))
@examples(one_of=3)
def test_a_path_that_begins_where_a_walk_does_is_found(walk: Ints) -> None:
    start = (int(walk[0, 0]), int(walk[0, 1]), int(walk[0, 2]))
    shape = Shape.from_cells(walk)
    if len(shape) >= 3:
        found = exact_path(shape, start=start).cells
        check(found, shape.cells)
        assert found is not None and tuple(found[0]) == start


def test_ends_lie_on_the_surface_when_asked_for() -> None:
    shape = Shape.from_cells(box(5, 5, 5))
    for seed in range(5):
        found = exact_path(shape, seed=seed, ends_on_surface=True).cells
        check(found, shape.cells)
        assert found is not None and surface(found)[[0, -1]].all()


def test_easing_brings_neighbours_closer_along_the_path() -> None:
    shape = Shape.from_cells(box(4, 4, 6))
    eased, plain = exact_path(shape).cells, exact_path(shape, eased=False).cells
    assert eased is not None and plain is not None
    assert spread(eased) < 0.8 * spread(plain)


def test_the_same_seed_gives_the_same_path() -> None:
    shape = Shape.from_cells(box(4, 4, 4))
    one, same, other = (exact_path(shape, seed=seed).cells for seed in (3, 3, 4))
    assert one is not None and other is not None
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


# Connected, even in colours, without dead ends or cut cells that forbid a path; found at random.
SUBTLE = (
    [
        *((-2, 0, 0), (-2, 0, 1), (-1, 0, -1), (-1, 0, 0), (-1, 0, 1), (-1, 0, 2), (-1, 1, -1)),
        *((0, 0, 0), (0, 0, 1)),
    ],
    [
        *((-1, 0, 0), (-1, 1, 0), (0, -1, 0), (0, 0, 0), (0, 0, 1), (0, 1, 0), (0, 1, 1)),
        (1, 1, 0),
    ],
)


@pytest.mark.parametrize("cells", SUBTLE)
def test_the_solver_proves_what_no_rule_tells(cells: list[tuple[int, int, int]]) -> None:
    shape = Shape.from_cells(cells)
    assert not obstacles(shape.cells)
    assert not has_path(shape.cells)
    search = exact_path(shape)
    assert search.status == "infeasible"
    assert "proved" in search.reason


def test_the_wrong_colour_to_start_with_is_refused_in_words() -> None:
    search = exact_path(Shape.from_cells(box(3, 3, 3)), start=(0, 0, 1))
    assert search.status == "infeasible"
    assert "colour" in search.reason
    assert exact_path(Shape.from_cells(box(3, 3, 3)), start=(1, 1, 0)).status == "found"


def test_a_start_that_is_no_cell_is_refused() -> None:
    with pytest.raises(InputError, match="cell of the shape"):
        exact_path(Shape.from_cells(box(2, 2, 2)), start=(5, 0, 0))


def test_a_buried_start_is_refused_where_ends_lie_on_the_surface() -> None:
    shape = Shape.from_cells(box(3, 3, 3))
    assert exact_path(shape, start=(1, 1, 1)).status == "infeasible"
    search = exact_path(Shape.from_cells(box(5, 5, 5)), start=(2, 2, 2), ends_on_surface=True)
    assert search.status == "infeasible"
    assert "surface" in search.reason


def test_the_solver_alone_finds_a_path() -> None:
    cells = np.array(box(3, 4, 3))
    ends = np.ones(len(cells), dtype=np.bool_)
    found = circuit(cells, np.random.default_rng(0), ends=ends)
    assert found.status == "found" and found.order is not None
    check(cells[found.order], cells)


def test_no_time_is_undecided_never_infeasible() -> None:
    cells = np.array(box(8, 8, 8))
    ends = np.ones(len(cells), dtype=np.bool_)
    found = circuit(cells, np.random.default_rng(0), ends=ends, effort=1e-6)
    assert found.status == "undecided" and found.order is None


# Colours rule out a path, which SAT solvers cannot prove in any time.
ENDLESS = np.array([cell for cell in box(6, 6, 6) if cell not in {(0, 0, 0), (5, 5, 0), (5, 0, 5)}])


def test_circuit_ends_with_its_time_limit() -> None:
    ends = np.ones(len(ENDLESS), dtype=np.bool_)
    found = circuit(
        ENDLESS, np.random.default_rng(0), ends=ends, start=0, effort=1e6, time_limit_s=0.2
    )
    assert found.status == "undecided" and found.order is None


def test_circuit_is_interrupted_by_ctrl_c() -> None:
    ends = np.ones(len(ENDLESS), dtype=np.bool_)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
    try:
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            circuit(ENDLESS, np.random.default_rng(0), ends=ends, start=0, effort=1e6)
    finally:
        timer.cancel()
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(
    ("nodes", "arcs", "status"),
    [
        (2, [(0, 1), (1, 0)], "found"),
        (3, [(0, 1), (1, 0)], "infeasible"),  # no arc at node 2
        (4, [(0, 1), (1, 0), (2, 3), (3, 2)], "infeasible"),  # two circuits only
        (3, [(0, 1), (1, 2), (2, 0), (1, 0)], "found"),
    ],
)
def test_circuit_solver_small_graphs_are_found_or_infeasible(
    nodes: int, arcs: list[tuple[int, int]], status: str
) -> None:
    found, order = CircuitSolver(nodes, arcs, seed=0, effort=1.0).solve()
    assert found == status
    assert order == (list(range(nodes)) if status == "found" else [])


@pytest.mark.parametrize("seed", range(5))
def test_circuit_solver_counts_down_to_the_fewest_arcs(seed: int) -> None:
    arcs = [(a, b) for a in range(6) for b in range(6) if a != b]
    dear = [(a, b) for a, b in arcs if (b - a) % 6 not in (1, 2)]
    solver = CircuitSolver(6, arcs, seed=seed, effort=1.0)
    for count in (4, 2, 0):
        solver.allow_at_most(count, dear)
        status, order = solver.solve()
        assert status == "found" and sorted(order) == list(range(6))
        used = zip(order, [*order[1:], order[0]], strict=True)
        assert sum(arc in dear for arc in used) <= count


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sets", "results"),
    [(feasible_sets, RESULTS), pytest.param(hard_sets, HARD_RESULTS, marks=pytest.mark.long)],
)
def test_the_stored_sets_are_those_that_their_results_are_of(
    sets: Callable[[], Iterator[FeasibleSet]], results: FilePath
) -> None:
    cells = list(sets())
    statuses = check_stored(cells, results)
    assert set(statuses.values()) <= {"found", "infeasible", "undecided"}
    changed = [replace(cells[0], cells=cells[0].cells + 1), *cells[1:]]
    with pytest.raises(AssertionError, match=cells[0].name):
        check_stored(changed, results)


@pytest.mark.slow
@pytest.mark.long
def test_what_nobody_knew_is_solved_proved_or_left_open() -> None:
    sets = list(hard_sets())
    known = check_stored(sets, HARD_RESULTS)
    for each in sets[::5]:
        search = exact_path(Shape.from_cells(each.cells), time_limit_s=20.0)
        assert {search.status, known[each.name]} != {"found", "infeasible"}
        if search.cells is not None:
            assert len(Path.from_cells(search.cells)) == len(each.cells)
