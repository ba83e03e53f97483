"""Chains of codes: kinematics of the modules against the exact lattice, and codes of chains."""

from itertools import product

import numpy as np

from foldback.planner.chain.built_in_modules import CUBE
from foldback.planner.chain.chain import Chain
from foldback.planner.pathfinding.snake_cubes import fold_sequence
from foldback.planner.twist_chains.cube_sequence import sequence_of_legs
from foldback.planner.twist_chains.figures import known_snake_cubes, snake_figures
from foldback.planner.twist_chains.folded_chains import (
    cube_chain,
    cube_module,
    cube_sequence_of,
    snake_chain,
    snake_code_of,
)
from foldback.planner.twist_chains.prism_lattice import places_of
from foldback.planner.twist_chains.snake_code import SnakeCode
from tests.case import case
from tests.refusal import refused

CELLS = np.array(list(product(range(3), repeat=3)), dtype=np.int64)


def test_prisms_lie_exactly_where_the_lattice_says() -> None:
    for figure in snake_figures():
        for code in (figure.code, figure.code.mirrored(), figure.code.from_other_end()):
            with case(figure.name):
                chain = snake_chain(code)
                poses = chain.folded_poses
                corners = chain.module.pieces[0].corners @ poses.rotations.transpose(0, 2, 1)
                corners = corners + poses.positions[:, None]
                for prism, place in zip(corners, places_of(code).corners / 2, strict=True):
                    distances = np.linalg.norm(prism[:, None] - place, axis=2)
                    assert (distances.min(axis=1) < 1e-9).all()
                    assert len(set(distances.argmin(axis=1))) == 6
                assert snake_code_of(chain) == code


def test_the_rod_is_straight() -> None:
    chain = snake_chain(SnakeCode((0,) * 23))
    steps = np.diff(chain.folded_poses.positions, axis=0)
    assert np.allclose(steps[0] + steps[1], steps[10] + steps[11])
    assert np.allclose(steps[0], steps[2])
    with refused("overlap", match="prisms 0 and 4"):
        snake_chain(SnakeCode((2, 2, 2, 2)))


def test_cubes_lie_in_the_cells_of_all_solutions() -> None:
    for puzzle in known_snake_cubes():
        for path in fold_sequence(puzzle.sequence, CELLS).paths[:, 0]:
            with case(puzzle.names):
                chain = cube_chain(path)
                assert np.allclose(chain.folded_poses.positions, path)
                assert cube_sequence_of(chain) == puzzle.sequence
                assert chain.module is cube_module(puzzle.sequence)


def test_a_snake_cube_at_rest_is_a_planar_zigzag() -> None:
    sequence = sequence_of_legs((2, 1, 3, 1))
    zigzag = Chain.from_angles(cube_module(sequence), np.zeros(len(sequence) - 1))
    expected = np.array([(0, 0), (1, 0), (2, 0), (2, 1), (3, 1), (4, 1), (5, 1), (5, 2)])
    assert np.allclose(zigzag.folded_poses.positions[:, :2], expected)
    assert np.allclose(zigzag.folded_poses.positions[:, 2], 0)
    for cells in (((0, 0, 0), (0, 1, 0)), ((0, 0, 0), (0, 0, 1), (0, 0, 2), (-1, 0, 2))):
        chain = cube_chain(np.array(cells))
        assert np.allclose(chain.folded_poses.positions, cells)


def test_other_chains_have_no_code() -> None:
    cubes = Chain.from_angles(CUBE, np.zeros(4))
    assert snake_code_of(cubes) is None
    assert cube_sequence_of(cubes) is None
    snake = snake_chain(SnakeCode((0, 1, 2)))
    assert cube_sequence_of(snake) is None
    between = Chain.from_angles(snake.module, np.array([0.0, 0.5, 0.0]))
    assert snake_code_of(between) is None
