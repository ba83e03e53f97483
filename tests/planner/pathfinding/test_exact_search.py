import os
import signal
import threading
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.feasible_sets import feasible_sets
from bench.paths import RESULTS, check_stored
from foldback.planner.errors import InputError
from foldback.planner.pathfinding.circuit_solver import CircuitSolver
from foldback.planner.pathfinding.exact_search import exact_path
from foldback.planner.pathfinding.lattice import neighbours, spread, surface
from foldback.planner.pathfinding.no_path_proofs import obstacles
from foldback.planner.pathfinding.sat_paths import find_path_by_sat
from foldback.planner.shapes.shape import Shape
from tests.case import case
from tests.planner.lattice import Ints, box, walks


def check(found_cells: Ints | None, cells: Ints) -> None:
    assert found_cells is not None
    assert (np.abs(np.diff(found_cells, axis=0)).sum(axis=1) == 1).all()
    assert np.array_equal(np.unique(found_cells, axis=0), cells)
    assert len(found_cells) == len(cells)


def has_path(cells: Ints) -> bool:
    """Return True if there is a path, by brute force; for a handful of cells."""
    near = [[k for k in row if k >= 0] for row in neighbours(cells).tolist()]

    def can_end(cell: int, cells_left: frozenset[int]) -> bool:
        return not cells_left or any(
            can_end(k, cells_left - {k}) for k in near[cell] if k in cells_left
        )

    everything = frozenset(range(len(cells)))
    return any(can_end(k, everything - {k}) for k in everything)


small_sets = st.sets(
    st.tuples(st.integers(0, 3), st.integers(0, 2), st.integers(0, 1)), min_size=3, max_size=11
)


@pytest.mark.slow
@given(cells=small_sets)
def test_search_agrees_with_trying_everything(cells: set[tuple[int, int, int]]) -> None:
    shape = Shape.from_cells(sorted(cells))
    search = exact_path(shape)
    assert search.status == ("found" if has_path(shape.cells) else "infeasible")
    if search.status == "found":
        check(search.cells, shape.cells)
    if obstacles(shape.cells):
        assert not has_path(shape.cells)


@given(walk=walks(maximum=120), seed=st.integers(0, 99), has_start=st.booleans())
def test_path_of_the_cells_of_a_walk_is_found(walk: Ints, seed: int, has_start: bool) -> None:
    start = (int(walk[0, 0]), int(walk[0, 1]), int(walk[0, 2])) if has_start else None
    shape = Shape.from_cells(walk)
    if len(shape) >= 3:
        cells = exact_path(shape, seed=seed, start=start).cells
        check(cells, shape.cells)
        assert cells is not None and start in (None, tuple(cells[0]))


def test_ends_are_on_the_surface_if_requested() -> None:
    shape = Shape.from_cells(box(5, 5, 5))
    for seed in range(2):
        cells = exact_path(shape, seed=seed, ends_on_surface=True).cells
        check(cells, shape.cells)
        assert cells is not None and surface(cells)[[0, -1]].all()


def test_easing_brings_neighbours_closer_along_the_path() -> None:
    shape = Shape.from_cells(box(4, 4, 6))
    eased, plain = exact_path(shape).cells, exact_path(shape, eased=False).cells
    assert eased is not None and plain is not None
    assert spread(eased) < 0.8 * spread(plain)


def test_seed_decides_the_path() -> None:
    shape = Shape.from_cells(box(4, 4, 4))
    first, repeated_cells, second = (exact_path(shape, seed=seed).cells for seed in (3, 3, 4))
    assert first is not None and second is not None
    assert np.array_equal(first, repeated_cells)
    assert not np.array_equal(first, second)


# Random search found these cells: they are connected and have balanced colours, and no dead ends or
# cut cells rule out a path.
WITHOUT_PATH = (
    *((0, 0, 1), (0, 0, 2), (0, 1, 2), (1, 0, 1), (2, 0, 1), (2, 0, 2), (2, 1, 2), (2, 2, 1)),
    *((2, 2, 2), (3, 0, 0), (3, 0, 1), (3, 1, 0), (3, 1, 1), (3, 1, 2), (3, 2, 2)),
)


def test_solver_proves_that_there_is_no_path() -> None:
    shape = Shape.from_cells(WITHOUT_PATH)
    assert not obstacles(shape.cells)
    assert not has_path(shape.cells)
    search = exact_path(shape)
    assert search.status == "infeasible"
    assert [reason.code for reason in search.reasons] == ["no-path-with-ends"]


def test_unsuitable_starts_are_refused_with_the_reason() -> None:
    small, large = Shape.from_cells(box(3, 3, 3)), Shape.from_cells(box(5, 5, 5))
    search = exact_path(small, start=(0, 0, 1))
    assert search.status == "infeasible"
    assert [reason.code for reason in search.reasons] == ["start-colour"]
    assert exact_path(small, start=(1, 1, 0)).status == "found"
    assert exact_path(small, start=(1, 1, 1)).status == "infeasible"
    search = exact_path(large, start=(2, 2, 2), ends_on_surface=True)
    assert search.status == "infeasible"
    assert [reason.code for reason in search.reasons] == ["start-inside"]
    with pytest.raises(InputError, match="cell of the shape"):
        exact_path(small, start=(5, 0, 0))


# Colours rule out a path, which SAT solvers cannot prove in any reasonable time.
ENDLESS = np.array([cell for cell in box(6, 6, 6) if cell not in {(0, 0, 0), (5, 5, 0), (5, 0, 5)}])


def test_circuit_ends_with_its_time_limit() -> None:
    ends = np.ones(len(ENDLESS), dtype=np.bool_)
    solver_result = find_path_by_sat(
        ENDLESS, np.random.default_rng(0), ends=ends, start=0, effort=1e6, time_limit_s=0.2
    )
    assert solver_result.status == "undecided" and solver_result.order is None
    solver_result = find_path_by_sat(
        ENDLESS, np.random.default_rng(0), ends=ends, start=0, effort=1e-6
    )
    assert solver_result.status == "undecided" and solver_result.order is None


def test_circuit_is_interrupted_by_ctrl_c() -> None:
    ends = np.ones(len(ENDLESS), dtype=np.bool_)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
    try:
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            find_path_by_sat(ENDLESS, np.random.default_rng(0), ends=ends, start=0, effort=1e6)
    finally:
        timer.cancel()
        signal.signal(signal.SIGINT, before)


def test_circuit_solver_small_graphs_are_found_or_infeasible() -> None:
    for nodes, arcs, status in (
        (2, [(0, 1), (1, 0)], "found"),
        (3, [(0, 1), (1, 0)], "infeasible"),  # no arc at node 2
        (4, [(0, 1), (1, 0), (2, 3), (3, 2)], "infeasible"),  # two circuits only
        (3, [(0, 1), (1, 2), (2, 0), (1, 0)], "found"),
    ):
        with case((nodes, arcs)):
            circuit, order = CircuitSolver(nodes, arcs, seed=0, effort=1.0).solve()
            assert circuit == status
            assert order == (list(range(nodes)) if status == "found" else [])


def test_circuit_solver_counts_down_to_the_fewest_arcs() -> None:
    arcs = [(a, b) for a in range(6) for b in range(6) if a != b]
    dear = [(a, b) for a, b in arcs if (b - a) % 6 not in (1, 2)]
    solver = CircuitSolver(6, arcs, seed=0, effort=1.0)
    for count in (4, 2, 0):
        solver.allow_at_most(count, dear)
        status, order = solver.solve()
        assert status == "found" and sorted(order) == list(range(6))
        used = zip(order, [*order[1:], order[0]], strict=True)
        assert sum(arc in dear for arc in used) <= count


@pytest.mark.slow
def test_stored_results_belong_to_the_generated_sets() -> None:
    cells = list(feasible_sets())
    statuses = check_stored(cells, RESULTS)
    assert set(statuses.values()) <= {"found", "infeasible", "undecided"}
    changed = [replace(cells[0], cells=cells[0].cells + 1), *cells[1:]]
    with pytest.raises(AssertionError, match=cells[0].name):
        check_stored(changed, RESULTS)
