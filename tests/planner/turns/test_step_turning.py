"""Turns of twist chains as steps: with room, one hinge at a time, ending at the folded angles."""

from pathlib import Path

import numpy as np
import pytest

from foldback import foldback_check
from foldback.planner.chain.built_in_modules import CUBE
from foldback.planner.chain.chain import Chain
from foldback.planner.clearance.sweep import sweep
from foldback.planner.explosion.strategies import ranked_strategies
from foldback.planner.pipeline.fold import fold
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.plan.steps import steps_of
from foldback.planner.readers.formats import read
from foldback.planner.turns.hinge_steps import HingeSteps
from foldback.planner.turns.step_turning import (
    MAX_WORK,
    StepTurning,
    roomiest_way,
    turns_in_steps,
    unwound,
)
from foldback.planner.turns.turn_sequence import NoTurns, TurnSequence, find_turns
from foldback.planner.twist_chains.figures import snake_figure
from foldback.planner.twist_chains.folded_chains import snake_chain
from foldback.planner.twist_chains.snake_code import SnakeCode

SIZE = 0.8
SHAPES = Path(__file__).parents[3] / "examples" / "shapes"


def chain_of(digits: str) -> Chain:
    return snake_chain(SnakeCode(tuple(int(digit) for digit in digits)))


def known_chain(name: str) -> Chain:
    figure = snake_figure(name)
    assert figure is not None
    return snake_chain(figure.code, name=name)


def frames_between(rests: np.ndarray, count: int = 20) -> np.ndarray:
    at = np.arange((len(rests) - 1) * count + 1) / count
    before = np.minimum(at.astype(np.int64), len(rests) - 2)
    return rests[before] + (at - before)[:, None] * (rests[before + 1] - rests[before])


@pytest.mark.parametrize("name", ["Cross1", "Flying Boat"])
def test_known_figures_fold_one_hinge_at_a_time(name: str) -> None:
    chain = unwound(known_chain(name), module_size=SIZE, seed=0)
    turns = find_turns(chain, module_size=SIZE, at_once=1, seed=0)
    assert isinstance(turns, TurnSequence)
    rests = turns.rest_angles_rad
    assert not rests[0].any()
    np.testing.assert_array_equal(rests[-1], chain.folded_rad)
    assert (np.abs(np.diff(rests, axis=0)) > 1e-9).sum(axis=1).tolist() == [1] * turns.turns
    assert np.abs(np.diff(rests, axis=0)).max() == pytest.approx(np.pi / 2)
    assert turns.room > 0.0
    assert sweep(chain, frames_between(rests), module_size=SIZE).bound > 0.0


def test_turns_at_once_are_proved_as_one_step() -> None:
    chain = unwound(known_chain("DNA Strand"), module_size=SIZE, seed=0)
    alone = find_turns(chain, module_size=SIZE, at_once=1, seed=0)
    merged = find_turns(chain, module_size=SIZE, at_once=None, seed=0)
    assert isinstance(alone, TurnSequence)
    assert isinstance(merged, TurnSequence)
    assert merged.turns <= alone.turns
    assert len(merged.hinges) < 0.5 * len(alone.hinges)
    frames = frames_between(merged.rest_angles_rad)
    assert sweep(chain, frames, module_size=SIZE).bound > 0.0


def test_a_figure_that_only_smaller_modules_reach_has_no_turns_at_a_larger_size() -> None:
    chain = chain_of("0220")
    turns = find_turns(chain, module_size=0.82, at_once=1, seed=0)
    assert isinstance(turns, NoTurns)
    np.testing.assert_array_equal(turns.last_rad[0], chain.folded_rad)


def test_unwinding_keeps_the_figure_and_other_chains() -> None:
    chain = known_chain("triangle")
    free = unwound(chain, module_size=SIZE, seed=0)
    whole_turns = (free.folded_rad - chain.folded_rad) / (2 * np.pi)
    np.testing.assert_allclose(whole_turns, np.rint(whole_turns), atol=1e-12)
    cubes = Chain.from_angles(CUBE, np.array([0.0, np.pi / 2]))
    assert unwound(cubes, module_size=SIZE, seed=0) is cubes
    between = Chain.from_angles(chain.module, np.array([0.0, 0.3]))
    assert not turns_in_steps(between)
    assert unwound(between, module_size=SIZE, seed=0) is between


def test_a_snake_is_folded_turn_by_turn_at_its_own_size(tmp_path: Path) -> None:
    chain = chain_of("0220")
    parameters = FoldRequest().parameters(chain.module)
    assert ranked_strategies(chain, parameters)[0] == "one-by-one"
    plan = fold(chain, directory=tmp_path / "snake")
    assert plan.certificate.verified
    assert plan.certificate.module_size == SIZE
    assert len(steps_of(plan).steps) == 4
    assert foldback_check.check(str(tmp_path / "snake" / "plan.npz"))["verdict"] == "proved"


def test_a_search_stops_at_its_work_and_says_how_much_it_took() -> None:
    turning = StepTurning(chain_of("0220"), SIZE)
    start = turning.folded
    steps = HingeSteps(chain_of("0220").module, 5)
    whole = roomiest_way(steps, start, min_size=SIZE, together=True, seed=0)
    assert whole.reached
    fresh = HingeSteps(chain_of("0220").module, 5)
    limit = whole.work // 2
    part = roomiest_way(fresh, start, min_size=SIZE, together=True, seed=0, max_work=limit)
    assert not part.reached
    assert limit < part.work < whole.work
    assert not turning.way(together=False, seed=0, max_work=limit).reached


def test_auto_folds_modules_of_several_parts_with_little_work() -> None:
    path = SHAPES / "molecube-coil.json"
    chain = read(path.read_bytes(), filename=path.name)
    assert isinstance(chain, Chain)
    size = FoldRequest().parameters(chain.module).module_size
    way = StepTurning(chain, size).way(together=False, seed=0, max_work=MAX_WORK)
    assert way.reached
    assert way.work < 0.2 * MAX_WORK


def test_auto_looks_for_motions_of_several_hinges_for_modules_of_one_part_alone() -> None:
    for name, turns in (("molecube-coil", False), ("yamor-spiral", True)):
        path = SHAPES / f"{name}.json"
        chain = read(path.read_bytes(), filename=path.name)
        assert isinstance(chain, Chain)
        ranked = ranked_strategies(chain, FoldRequest().parameters(chain.module))
        assert ranked == ("one-by-one", *(["turns"] if turns else []), "simultaneous")
