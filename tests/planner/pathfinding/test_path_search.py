import numpy as np
import pytest

from foldback.planner.errors import InputError
from foldback.planner.pathfinding import PATH_METHODS
from foldback.planner.pathfinding.knots import knot_of
from foldback.planner.pathfinding.lattice import spread, surface
from foldback.planner.pathfinding.path_search import find_paths, ranked
from foldback.planner.pathfinding.removal_analysis import analyse_removal
from foldback.planner.pathfinding.snake import snake_path
from foldback.planner.shapes.shape import Shape
from tests.case import case
from tests.planner.chains import walk
from tests.planner.lattice import box
from tests.planner.pathfinding.test_knots import OVERHAND

BENT = Shape.from_cells(box(6, 2, 2) + box(2, 6, 2), name="bent")  # 2×2×2 blocks
PLATE = Shape.from_cells([c for c in box(5, 5, 2) if c[:2] != (2, 2)], name="plate")
BOX = Shape.from_cells(box(4, 3, 2), name="box")
# Blocks on no common grid: the upper one is shifted by half a block.
STEP = Shape.from_cells(box(4, 2, 2) + [(x + 1, y, z + 2) for x, y, z in box(2, 2, 2)])


def test_method_is_chosen_by_the_shape() -> None:
    for shape, method in ((BOX, "snake"), (BENT, "blocks"), (STEP, "blocks"), (PLATE, "exact")):
        search = find_paths(shape)
        assert (search.method, search.reasons) == (method, ())
        assert 1 <= len(search.paths) <= 4
        for path in search.paths:
            assert np.array_equal(np.unique(path.cells, axis=0), shape.cells)
            assert (path.name, path.pitch_m) == (shape.name, shape.pitch_m)


def test_large_shapes_are_peeled() -> None:
    shape = Shape.from_cells(
        [c for c in box(10, 10, 10) if not (min(c[:2]) >= 4 and max(c[:2]) < 6 and c[2] >= 4)]
    )
    search = find_paths(shape)
    assert search.method == "assembly"
    best = search.paths[0].cells
    assert analyse_removal(best).score == 1.0
    assert np.array_equal(np.unique(best, axis=0), shape.cells)
    start = (0, 0, 0)
    started = find_paths(shape, start=start)
    assert started.paths and tuple(started.paths[0].cells[0]) == start


def test_method_assembly_works_for_boxes_and_blocks_only() -> None:
    assert find_paths(BENT, method="assembly").method == "assembly"
    none = find_paths(PLATE, method="assembly")
    assert none.paths == () and [reason.code for reason in none.reasons] == ["no-assembly"]


def test_seed_decides_the_candidates() -> None:
    first, repeated_cells, second = (
        find_paths(BENT, seed=seed).paths[-1].cells for seed in (1, 1, 2)
    )
    assert np.array_equal(first, repeated_cells)
    assert not np.array_equal(first, second)


def test_candidates_are_ranked_by_knot_and_then_by_spread() -> None:
    overhand = walk(OVERHAND)
    assert knot_of(overhand).verdict == "knotted"
    winding = snake_path((5, 5, 4))
    assert spread(overhand) < spread(winding)
    assert ranked([overhand, winding])[0] is winding


def test_ends_are_on_the_surface_if_requested() -> None:
    search = find_paths(BENT, ends="surface")
    assert search.paths
    for path in search.paths:
        assert surface(path.cells)[[0, -1]].all()
    spreads = [spread(path.cells) for path in search.paths]
    assert spreads == sorted(spreads)  # those with the closest neighbours come first


def test_path_starts_in_the_requested_cell() -> None:
    for shape, method, start in (
        (BENT, "blocks", (0, 5, 1)),
        (STEP, "blocks", (2, 1, 3)),
        (BOX, "auto", (2, 1, 1)),
        (PLATE, "exact", (0, 3, 1)),
    ):
        with case((shape, method)):
            search = find_paths(shape, method=method, start=start)
            assert search.paths
            for path in search.paths:
                assert tuple(path.cells[0]) == start


PARTS = Shape.from_cells(box(2, 2, 2) + [(x + 4, y, z) for x, y, z in box(2, 2, 2)])


def test_no_path_is_explained() -> None:
    for shape, method, code in (
        (PLATE, "blocks", "no-blocks"),
        (BENT, "snake", "no-box"),
        (Shape.from_cells([(0, 0, 0), (1, 0, 0), (5, 0, 0)]), "auto", "disconnected"),
        (Shape.from_cells([*box(2, 2, 2), (9, 0, 0)]), "exact", "disconnected"),
        *((PARTS, method, "disconnected") for method in ("auto", "blocks")),
    ):
        with case((shape, method)):
            search = find_paths(shape, method=method)
            assert search.paths == ()
            assert [reason.code for reason in search.reasons] == [code]


def test_options_out_of_range_are_refused() -> None:
    assert tuple(PATH_METHODS) == ("auto", "blocks", "fitted", "exact", "snake")
    with pytest.raises(InputError, match="expected one of: auto, blocks, fitted, exact, snake"):
        find_paths(BOX, method="magic")
    with pytest.raises(InputError, match="expected 'any' or 'surface'"):
        find_paths(BOX, ends="inside")
    with pytest.raises(InputError, match="cell of the shape"):
        find_paths(BOX, start=(9, 9, 9))
