import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

from foldback.planner.errors import InputError
from foldback.planner.pathfinding.lattice import neighbours
from foldback.planner.table_paths.base_sides import sides_of
from foldback.planner.table_paths.no_table_path_proofs import ruled_out
from foldback.planner.table_paths.rules import Rule, rule_violations
from foldback.planner.table_paths.table_paths import TablePath
from tests.case import case
from tests.conftest import examples
from tests.planner.lattice import Ints, box_array, walks
from tests.planner.table_search import reasons_for_no_path, table_paths
from tests.refusal import refused

SHAPES = Path(__file__).parents[3] / "examples" / "shapes"


def shape(name: str) -> Ints:
    return np.array(json.loads((SHAPES / f"{name}.json").read_bytes())["cells"], dtype=np.int64)


def front(*rows: str) -> Ints:
    """Return cells as seen from the front, the highest row first, one deep."""
    return np.array(
        [
            (x, 0, len(rows) - 1 - row)
            for row, line in enumerate(rows)
            for x, mark in enumerate(line)
            if mark == "#"
        ]
    )


def check(paths: tuple[TablePath, ...], cells: Ints, *, rule: Rule = "layers") -> None:
    assert paths
    for path in paths:
        assert path.rule == rule
        assert rule_violations(path.cells, rule=rule) == ()
        laid = cells @ path.turn.T + path.shift
        assert laid[:, 2].min() == 0
        assert np.array_equal(np.unique(path.cells, axis=0), np.unique(laid, axis=0))
        assert len(path.cells) == len(cells)
    scores = [path.score for path in paths]
    assert len({path.cells.tobytes() for path in paths}) == len(paths)
    assert scores[0] == min(scores)


def has_path(cells: Ints) -> bool:
    """Return True if there is a path, by brute force; for a handful of cells."""
    near = [[k for k in row if k >= 0] for row in neighbours(cells).tolist()]

    def can_end(way: list[int]) -> bool:
        if len(way) == len(cells):
            return not rule_violations(cells[way])
        free = (k for k in near[way[-1]] if k not in way and cells[k, 2] >= cells[way[-1], 2])
        return any(can_end([*way, k]) for k in free)

    return any(can_end([k]) for k in range(len(cells)))


def test_boxes_have_paths_that_keep_all_rules() -> None:
    for sides in ((3, 3, 3), (5, 3, 2)):
        check(table_paths(box_array(*sides), max_paths=4), box_array(*sides))
    assert len(table_paths(box_array(3, 3, 2), max_paths=5)) == 5


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cup", pytest.param("chair", marks=pytest.mark.long)])
def test_shapes_of_the_gallery_have_paths(name: str) -> None:
    cells = shape(name)
    check(table_paths(cells, max_paths=2), cells)


def test_seed_decides_the_paths() -> None:
    first, repeated_path, second = (
        table_paths(box_array(5, 4, 2), seed=seed, max_paths=1)[0].cells.tolist()
        for seed in (3, 3, 4)
    )
    assert first == repeated_path
    assert first != second


def test_stable_overhang_has_a_path() -> None:
    standing = front("###.", "##..", "##..")
    deep = np.concatenate([standing, standing + (0, 1, 0)])
    path = table_paths(deep, turned=False)[0]
    check((path,), deep)
    assert path.parts.overhang > 0


TEE = front("###########", "....###....")
PLUS = np.array([(1, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0), (1, 2, 0)])


def test_shape_without_a_path_is_refused_with_the_reason() -> None:
    for cells, code, words in (
        (front("######", "##....", "##...."), "not-stable", "centre of mass"),
        (np.concatenate([TEE, TEE + (0, 1, 0)]), "not-stable", "cells of the path would tip over"),
        (front("####", "#..#", "#..#"), "overhang", "2 cells with nothing below"),
        (front("#..#", "#..#", "####"), "parts", "layer 2"),
        (front("###", "###"), "hairpins-only", "cannot turn back directly above itself"),
        (PLUS, "no-path", "chessboard"),
        (box_array(1, 1, 6), "no-path", "only one cell touches the floor"),
    ):
        with case((cells, code)):
            with refused(code, match=words):
                table_paths(cells, turned=False)
            if code == "overhang":
                (reason,) = reasons_for_no_path(cells, turned=False)
                assert set(reason.cells) == {(1, 0, 2), (2, 0, 2)}


def test_shapes_lie_if_they_have_no_path_standing() -> None:
    arch = front("####", "#..#", "#..#")
    check(table_paths(arch), arch)
    assert reasons_for_no_path(front("###", "###")) == ()
    path = table_paths(box_array(1, 1, 6))[0]
    assert path.down != "-z" and (path.cells[:, 2] == 0).all()
    assert reasons_for_no_path(shape("wrench-24"))[0].code == "hairpins-only"


def test_parity_of_a_layer_is_a_reason() -> None:
    comb = np.concatenate([box_array(5, 1, 1), 2 * box_array(3, 1, 1) + (0, 1, 0)])
    (side,) = sides_of(np.concatenate([comb, comb + (0, 0, 1)]).astype(np.int64), turned=False)
    reason = ruled_out(side)
    assert (
        reason is not None
        and "layer 1 from the bottom: if the cells are coloured" in reason.reason.text
    )


@pytest.mark.long
@pytest.mark.slow
def test_path_goes_down_only_where_necessary() -> None:
    cells = shape("pawn")
    (path,) = table_paths(cells, max_paths=1)
    check((path,), cells, rule="falls")
    assert 0 < path.parts.downs < 0.05
    assert any(fault.code == "goes-down" for fault in rule_violations(path.cells))


def test_too_few_cells_are_refused() -> None:
    with pytest.raises(InputError, match="expected at least 3"):
        table_paths([(0, 0, 0), (1, 0, 0)])
    with pytest.raises(InputError, match="no cells"):
        reasons_for_no_path([])


@given(walk=walks(maximum=60))
@examples(one_of=2)
def test_paths_keep_the_rules_or_a_reason_is_given(walk: Ints) -> None:
    if len(walk) < 3:
        return
    try:
        paths = table_paths(walk, max_paths=3)
    except InputError as error:
        reasons = reasons_for_no_path(walk)
        assert error.code in {reason.code for reason in reasons}
        assert [reason.down for reason in reasons] == [side.down for side in sides_of(walk)]
    else:
        check(paths, walk, rule=paths[0].rule)
        assert reasons_for_no_path(walk) == ()


@given(walk=walks(maximum=9))
@examples(one_of=2)
def test_search_agrees_with_trying_everything(walk: Ints) -> None:
    if len(walk) < 3:
        return
    (side,) = sides_of(walk, turned=False)
    is_possible = not reasons_for_no_path(walk, turned=False)
    rule = table_paths(walk, turned=False)[0].rule if is_possible else ""
    assert (rule == "layers") == has_path(side.cells)
