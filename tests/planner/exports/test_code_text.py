"""Codes as an export: all notations of a figure and of the pieces of a snake cube."""

import dataclasses
from itertools import product

import numpy as np
import pytest

from foldback.planner.chain.built_in_modules import module_named
from foldback.planner.chain.chain import Chain
from foldback.planner.exports.code_text import write
from foldback.planner.pathfinding.snake_cubes import fold_sequence
from foldback.planner.plan.plan import Plan
from foldback.planner.readers.twist_codes import EXAMPLES, read_twist_code
from foldback.planner.twist_chains.figures import known_snake_cubes, snake_figures
from foldback.planner.twist_chains.folded_chains import cube_chain, has_code, is_coded, snake_chain
from foldback.planner.twist_chains.snake_code import SnakeCode
from tests.planner.conftest import Folded
from tests.refusal import refused


def lines_of(plan: Plan, chain: Chain) -> dict[str, str]:
    text = write(dataclasses.replace(plan, chain=chain)).decode()
    return dict(line.split(": ", 1) for line in text.splitlines())


def test_code_of_a_figure(folded: Folded) -> None:
    figure = next(figure for figure in snake_figures() if figure.name == "Ball")
    lines = lines_of(folded.plan, snake_chain(figure.code))
    assert lines["digits"] == "11331311313311331311313(3)"
    assert lines["known as"] == "Ball"
    assert lines["prisms"] == "24"
    for name in EXAMPLES.keys() & lines.keys():
        assert read_twist_code(f"{name}: {lines[name]}") == figure.code
    assert read_twist_code(lines["mirror image"]) == figure.code.mirrored()
    assert read_twist_code(lines["from the other end"]) == figure.code.from_other_end()
    rod = lines_of(folded.plan, snake_chain(SnakeCode((0,) * 5)))
    assert rod["digits"] == "00000"
    assert "known as" not in rod


def test_code_of_a_snake_cube(folded: Folded) -> None:
    sequence = known_snake_cubes()[0].sequence
    cells = np.array(list(product(range(3), repeat=3)), dtype=np.int64)
    chain = cube_chain(fold_sequence(sequence, cells).paths[0, 0])
    lines = lines_of(folded.plan, chain)
    for name in EXAMPLES.keys() & lines.keys():
        assert read_twist_code(f"{name}: {lines[name]}") == sequence
    assert lines["known as"] == "Kev's Kubes"
    assert len(lines["quarter turns from the zigzag"].split()) == 26


@pytest.mark.parametrize(
    ("name", "is_true"),
    [("cube", False), ("tetrahedron", False), ("snake-prism", True), ("snake-cube", True)],
)
def test_only_twist_chains_have_codes(name: str, is_true: bool) -> None:
    assert is_coded(name) == is_true


def test_other_plans_are_refused(folded: Folded) -> None:
    assert not is_coded("somebodys-module")
    assert not has_code(folded.plan.chain)
    with refused("no-code"):
        write(folded.plan)
    angles = np.deg2rad([90.0, 0.0, 45.0])
    assert not has_code(Chain.from_angles(module_named("snake-prism"), angles))
