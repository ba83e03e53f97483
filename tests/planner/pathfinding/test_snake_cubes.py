"""Foldings of snake cubes: known cubes, published counts, symmetries, interruptions."""

from itertools import pairwise

import numpy as np
import pytest

from bench.snake_cubes import PUBLISHED, count_sequences
from foldback.planner.arrays import Ints
from foldback.planner.pathfinding.snake_cubes import (
    MAX_PIECES,
    box_cells,
    box_chains,
    boxes_of,
    default_max_steps,
    find_common_sequence,
    find_sequence,
    fold_sequence,
    symmetries_of,
)
from foldback.planner.twist_chains.cube_sequence import CubeSequence, sequence_of_legs
from foldback.planner.twist_chains.figures import known_snake_cubes
from tests.case import case
from tests.refusal import refused


def check(path: Ints, cells: Ints, sequence: CubeSequence) -> None:
    """Assert that a path visits each cell of a solid once, with these pieces."""
    assert sorted(path.tolist()) == sorted(cells.tolist())
    assert (np.abs(np.diff(path, axis=0)).sum(axis=1) == 1).all()
    steps = np.diff(path, axis=0).tolist()
    turns = [before != after for before, after in pairwise(steps)]
    assert turns == list(sequence.corners[1:-1])


def test_known_cubes_have_the_published_numbers_of_solutions() -> None:
    cells = box_cells((3, 3, 3))
    for puzzle in known_snake_cubes():
        for sequence in (puzzle.sequence, puzzle.sequence.from_other_end()):
            with case(puzzle.names):
                search = fold_sequence(sequence, cells)
                assert search.is_complete
                assert len(search.paths) == puzzle.solutions
                for path in search.paths[:, 0]:
                    check(path, cells, sequence)


def test_sequences_of_a_cube_are_as_many_as_published() -> None:
    cells = box_cells((3, 3, 3))
    search = find_sequence(cells, max_solutions=200_000)
    assert search.is_complete
    assert count_sequences(cells, search.paths[:, 0]) == PUBLISHED


def test_solutions_are_all_paths_up_to_symmetries() -> None:
    """Against a search without any shortcut, through small boxes and a solid without symmetries."""

    def all_paths(cells: Ints) -> list[tuple[int, ...]]:
        order = {cell: index for index, cell in enumerate(map(tuple, cells.tolist()))}
        steps = [step for axis in np.eye(3, dtype=int) for step in (axis, -axis)]
        paths = [(start,) for start in range(len(cells))]
        for _ in range(len(cells) - 1):
            paths = [
                (*path, index)
                for path in paths
                for step in steps
                if (index := order.get(tuple((cells[path[-1]] + step).tolist()))) is not None
                and index not in path
            ]
        return paths

    for cells in (
        box_cells((2, 2, 3)),
        box_cells((3, 3, 1)),
        np.array([*box_cells((2, 2, 2)), (2, 0, 0), (2, 1, 0), (3, 1, 0)]),
    ):
        with case(len(cells)):
            symmetries = symmetries_of(cells)
            orbits = {
                min(tuple(int(i) for i in row[list(path)]) for row in symmetries)
                for path in all_paths(cells)
            }
            search = find_sequence(cells, max_solutions=10_000)
            assert search.is_complete
            assert len(search.paths) == len(orbits)


def test_symmetries() -> None:
    for cells, count in (
        (box_cells((3, 3, 3)), 48),
        (box_cells((2, 3, 4)), 8),
        (box_cells((3, 1, 1)), 2),
        (box_cells((1, 1, 1)), 1),
    ):
        with case(count):
            symmetries = symmetries_of(cells)
            assert len(symmetries) == count
            assert (np.sort(symmetries) == np.arange(len(cells))).all()


def test_a_search_can_be_interrupted(monkeypatch: pytest.MonkeyPatch) -> None:
    cells, sequence = box_cells((3, 3, 3)), known_snake_cubes()[1].sequence
    whole = fold_sequence(sequence, cells)
    monkeypatch.setattr("foldback.planner.pathfinding.snake_cubes.SLICE_STEPS", 100)
    sliced = fold_sequence(sequence, cells)
    assert (sliced.paths == whole.paths).all()
    assert sliced.steps == whole.steps
    looks = iter([False] * 5)
    cancelled = fold_sequence(sequence, cells, cancelled=lambda: next(looks, True))
    assert not cancelled.is_complete
    assert cancelled.steps == 500
    limited = fold_sequence(sequence, cells, max_steps=250)
    assert (limited.is_complete, limited.steps) == (False, 250)


def test_one_solution_of_a_large_cube() -> None:
    cells = box_cells((4, 4, 4))
    bits = "0111110111010011001001001100101011011011111110011111111101111110"
    sequence = CubeSequence(tuple(bit == "1" for bit in bits))
    search = fold_sequence(sequence, cells, max_solutions=1, max_steps=1_000_000)
    check(search.paths[0, 0], cells, sequence)
    again = fold_sequence(sequence, cells, max_solutions=1, max_steps=1_000_000)
    assert again.steps == search.steps
    assert (again.paths == search.paths).all()


def test_sequences_with_so_many_corners() -> None:
    cells = box_cells((3, 3, 3))
    search = find_sequence(cells, 20)
    assert search.sequences[0].corner_count == 20
    check(search.paths[0, 0], cells, search.sequences[0])
    none = find_sequence(box_cells((2, 3, 3)), 5)
    assert (none.is_complete, len(none.paths)) == (True, 0)
    with refused("wrong-count"):
        find_sequence(cells, 26)


def test_one_sequence_for_two_solids() -> None:
    solids = (box_cells((3, 3, 3)), box_cells((1, 3, 9)))
    search = find_common_sequence(solids)
    for k, cells in enumerate(solids):
        check(search.paths[0, k], cells, search.sequences[0])
    none = find_common_sequence((box_cells((2, 2, 2)), box_cells((1, 1, 8))))
    assert (none.is_complete, len(none.paths)) == (True, 0)
    with refused("wrong-count"):
        find_common_sequence((box_cells((2, 2, 2)), box_cells((3, 3, 1))))


def test_solids_that_no_path_fills() -> None:
    star = np.array([(0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)])
    apart = np.array([(0, 0, 0), (1, 0, 0), (5, 0, 0), (6, 0, 0)])
    for cells in (star, apart):
        search = find_sequence(cells)
        assert (search.is_complete, len(search.paths)) == (True, 0)
    with refused("wrong-count"):
        fold_sequence(sequence_of_legs((2, 2)), box_cells((3, 3, 3)))
    with refused("too-many-cells"):
        find_sequence(box_cells((MAX_PIECES + 1, 1, 1)))


def test_chains_of_sequences_lie_in_the_box_closest_to_a_cube() -> None:
    puzzle = known_snake_cubes()[1]
    chains = box_chains(puzzle.sequence.from_other_end())
    assert len(chains) == puzzle.solutions
    for chain in chains:
        assert chain.name == puzzle.names[0]
        cells = np.rint(chain.folded_poses.positions).astype(int)
        assert sorted(cells.tolist()) == box_cells((3, 3, 3)).tolist()
    assert boxes_of(36)[:2] == ((3, 3, 4), (2, 3, 6))
    assert box_chains(sequence_of_legs((2, 1, 2)))[0].name == "Snake cube 1 × 2 × 3"
    with refused("no-folding", match="all ways were tried"):
        box_chains(sequence_of_legs((2, 2, 1, 1, 1)))
    assert default_max_steps(640) * 10 == default_max_steps(27)
