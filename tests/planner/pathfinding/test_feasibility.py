import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foldback.planner.pathfinding.exact_search import exact_path
from foldback.planner.pathfinding.feasibility import Repair, apply_repair, feasibility
from foldback.planner.pathfinding.path_search import find_paths
from foldback.planner.shapes.shape import Shape
from tests.case import case
from tests.conftest import examples
from tests.planner.lattice import NEIGHBOURS, box
from tests.planner.pathfinding.test_exact_search import WITHOUT_PATH

Cell = tuple[int, int, int]


CROSS = [(0, 0, 0), *NEIGHBOURS, *((2 * x, 2 * y, 2 * z) for x, y, z in NEIGHBOURS)]
CHECKERED = [c for c in box(3, 3, 3) if c not in ((0, 1, 0), (1, 0, 0), (1, 2, 0))]
SEPARATE = box(3, 3, 3) + [(x + 5, y, z) for x, y, z in box(2, 2, 2)]
DISTANT = box(3, 3, 3) + [(x + 50, y, z) for x, y, z in box(2, 2, 2)]
LOPSIDED = [(x, 0, 0) for x in range(9)] + [(7, 1, 0), (7, -1, 0)]


def test_shape_with_a_path_is_feasible() -> None:
    for sides in ((3, 3, 3), (4, 2, 2), (1, 1, 3)):
        computed_feasibility = feasibility(Shape.from_cells(box(*sides)))
        assert computed_feasibility.feasible is True, sides
        assert computed_feasibility.problems == () and computed_feasibility.repairs == (), sides


def test_shape_without_a_path_is_explained_and_repaired() -> None:
    for cells, codes in (
        ([(0, 0, 0)], {"too-few"}),
        (SEPARATE, {"disconnected"}),
        (CROSS, {"dead-ends", "cut-cells"}),
        (LOPSIDED, {"dead-ends", "cut-cells"}),
    ):
        with case((cells, codes)):
            shape = Shape.from_cells(cells)
            computed_feasibility = feasibility(shape)
            assert computed_feasibility.feasible is False
            assert codes <= {problem.code for problem in computed_feasibility.problems}
            assert all(
                set(problem.cells) <= set(map(tuple, cells))
                for problem in computed_feasibility.problems
            )
            assert computed_feasibility.repairs
            for repair in computed_feasibility.repairs:
                mended = apply_repair(shape, repair)
                assert find_paths(mended, candidates=1).paths, repair.detail


def test_separate_parts_are_bridged_or_dropped() -> None:
    repairs = feasibility(Shape.from_cells(SEPARATE)).repairs
    changed = [len(repair.add) + len(repair.drop) for repair in repairs[:-1]]
    assert changed == sorted(changed)
    assert [repair.doubled for repair in repairs] == [False] * (len(repairs) - 1) + [True]
    bridge, keep, _ = repairs
    assert (len(bridge.add), bridge.drop) == (2, ())
    assert (keep.add, len(keep.drop)) == ((), 8)
    assert all(repair.add == () for repair in feasibility(Shape.from_cells(DISTANT)).repairs)


def test_parity_is_repaired_with_the_fewest_cells() -> None:
    # One cell more or less changes the excess by one, and an excess of one is allowed.
    shape = Shape.from_cells(CHECKERED)
    excess = abs(int((1 - 2 * (shape.cells.sum(axis=1) % 2)).sum()))
    computed_feasibility = feasibility(shape)
    codes = {problem.code for problem in computed_feasibility.problems}
    assert codes == {"parity", "uneven-part"}
    first = computed_feasibility.repairs[0]
    assert len(first.add) + len(first.drop) == excess - 1


def test_apply_repair() -> None:
    shape = Shape.from_cells([(0, 0, 0), (1, 0, 0), (5, 0, 0)], name="odd", pitch_m=0.02)
    mended = apply_repair(shape, Repair(detail="", done="", add=((2, 0, 0),), drop=((5, 0, 0),)))
    assert mended.cells.tolist() == [[0, 0, 0], [1, 0, 0], [2, 0, 0]]
    assert (mended.name, mended.pitch_m) == ("odd", 0.02)
    twice = apply_repair(shape, Repair(detail="", done="", drop=((5, 0, 0),), doubled=True))
    assert twice.cells.tolist() == [list(cell) for cell in box(4, 2, 2)]
    assert twice.pitch_m == 0.01


def test_missing_path_is_proved_by_the_solver() -> None:
    shape = Shape.from_cells(WITHOUT_PATH)
    computed_feasibility = feasibility(shape)
    assert [problem.code for problem in computed_feasibility.problems] == ["no-path"]
    assert computed_feasibility.repairs[0].doubled is False
    assert exact_path(apply_repair(shape, computed_feasibility.repairs[0])).status == "found"


@pytest.mark.slow
@given(
    cells=st.sets(
        st.tuples(st.integers(0, 4), st.integers(0, 3), st.integers(0, 2)), min_size=4, max_size=30
    )
)
@examples(one_of=10)
def test_offered_repairs_have_paths(cells: set[Cell]) -> None:
    shape = Shape.from_cells(sorted(cells))
    computed_feasibility = feasibility(shape, time_limit_s=0.2)
    assert computed_feasibility.feasible is not False or computed_feasibility.problems
    for repair in computed_feasibility.repairs:
        mended = apply_repair(shape, repair)
        assert find_paths(mended, candidates=1, time_limit_s=5.0).paths
    if computed_feasibility.feasible is False:
        assert np.any([repair.doubled for repair in computed_feasibility.repairs])
