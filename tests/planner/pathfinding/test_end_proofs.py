import json

import numpy as np
import pytest
from hypothesis import given

from foldback.planner.errors import InputError
from foldback.planner.pathfinding.end_proofs import end_proof
from foldback.planner.pathfinding.feasibility import apply_repair, feasibility
from foldback.planner.pathfinding.fill_cubes import Cubes
from foldback.planner.pathfinding.lattice import colours, neighbours
from foldback.planner.pathfinding.no_path_proofs import obstacles
from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.pipeline.prepare import prepare
from foldback.planner.shapes.shape import Shape
from tests.planner.lattice import NEIGHBOURS, Ints, walks
from tests.planner.pathfinding.test_exact_search import (
    has_path,
    small_sets,
)

Cell = tuple[int, int, int]


CROWDED = [
    (-1, 0, 0),
    (-1, 1, 0),
    (0, -1, 0),
    (0, 0, 0),
    (0, 0, 1),
    (0, 1, 0),
    (0, 1, 1),
    (1, 1, 0),
]


def missing_ends(cells: list[Cell], named: tuple[Cell, ...]) -> int:
    """Count the ends beyond those that a path has, by nothing but the named cells."""
    shape, marked = set(cells), set(named)
    assert marked <= shape
    black = {cell for cell in shape if sum(cell) % 2 == 0}
    marked_colour = black if marked <= black else shape - black
    assert marked <= marked_colour
    touched: dict[Cell, int] = {}
    for x, y, z in marked:
        for dx, dy, dz in NEIGHBOURS:
            beside = (x + dx, y + dy, z + dz)
            if beside in shape:
                touched[beside] = touched.get(beside, 0) + 1
    places = sum(min(count, 2) for count in touched.values())
    allowed = 1 + 2 * len(marked_colour) - len(shape)
    return 2 * len(marked) - places - allowed


def test_sets_that_need_too_many_ends_are_named() -> None:
    rng = np.random.default_rng(0)
    proved = 0
    for _ in range(400):
        cells = np.argwhere(rng.random((5, 5, 3)) < 0.7)
        for problem in obstacles(cells):
            if problem.code == "ends":
                ordered = [(x, y, z) for x, y, z in cells.tolist()]
                assert missing_ends(ordered, problem.cells) > 0
                proved += 1
    assert proved > 10


@given(cells=small_sets)
def test_no_set_with_a_path_is_refused(cells: set[Cell]) -> None:
    ordered = sorted(cells)
    for problem in obstacles(np.array(ordered)):
        if problem.code == "ends":
            assert missing_ends(ordered, problem.cells) > 0
            assert not has_path(np.array(ordered))


@given(walk=walks(maximum=120))
def test_cells_of_a_walk_have_no_proof(walk: Ints) -> None:
    assert end_proof(neighbours(walk), 1 - 2 * colours(walk)) is None


def test_refusal_counts_and_offers_the_nearest_cells() -> None:
    shape = Shape.from_cells(CROWDED)
    computed_feasibility = feasibility(shape)
    (problem,) = computed_feasibility.problems
    assert problem.code == "ends"
    assert "3 cells, of which no two touch, share faces with only 3 others" in problem.reason.text
    nearest = computed_feasibility.repairs[0]
    assert not nearest.doubled and len(nearest.add) + len(nearest.drop) == 1
    assert feasibility(apply_repair(shape, nearest)).feasible


def test_refusal_names_the_cells_to_count_and_the_cells_to_change() -> None:
    shape = Shape.from_cells(CROWDED)
    data = json.dumps(CROWDED).encode()
    options = PathOptions(method="exact", as_voxels=True)
    with pytest.raises(InputError) as refusal:
        Cubes().check(shape, options)
    with pytest.raises(InputError) as later:
        _ = prepare(data, "crowded.json", options).chain
    near = feasibility(shape).repairs[:2]
    for error in (refusal.value, later.value):
        assert "The cells are (-1, 1, 0), (0, 1, 1) and (1, 1, 0)." in error.detail
        assert f"the cell {near[0].add[0]}, for 9 modules" in error.detail
        assert f"the cell {near[1].drop[0]}, for 7 modules" in error.detail
