"""Wrong arguments of the turns of joints raise errors, and none is read beyond its end."""

from typing import Any

import numpy as np
import pytest

from foldback.planner.chain.built_in_modules import module_named
from foldback.planner.core import JointTurns
from foldback.planner.core.structures import TurnSearch
from foldback.planner.turns.hinge_steps import turning_chain

CHAIN = turning_chain(module_named("snake-prism"), 5)
SEARCH = TurnSearch(
    size=1.0,
    min_size=1.0,
    depth_weight=0.2,
    near_weight=0.5,
    together=1,
    max_states=100,
    max_motions=100,
    max_work=0,
    seed=0,
)
STATE = np.array([0, 2, 2, 0], np.int8)


@pytest.mark.parametrize(
    "change",
    [
        {"anchor": CHAIN.anchor[:3].copy()},
        {"turn": CHAIN.turn[:, :2].copy()},
        {"axes": CHAIN.axes[:3].copy()},
        {"steps": CHAIN.steps[:3].copy()},
        {"levels": CHAIN.levels[:, :1].copy()},
        {"period": np.full(4, 1000)},
        {"hinge_of": np.array([0, 1, 2, 3, 9])},
        {"hinge_of": np.array([0, 3, 2, 3, 4])},
        {"hull": CHAIN.hull._replace(kinds=np.array([7]))},
        {"apart": 0},
    ],
    ids=lambda change: next(iter(change)),
)
def test_chains_of_wrong_shapes_are_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"chain|kinds"):
        JointTurns(CHAIN._replace(**change))


def test_wrong_arguments_of_methods_are_refused() -> None:
    turns = JointTurns(CHAIN)
    numbers = np.array([0, 1]), np.array([1, 1])
    with pytest.raises(ValueError, match="levels"):
        turns.resting_size(STATE[:3].copy())
    with pytest.raises(ValueError, match="hinge"):
        turns.turn_size(STATE, 4, 1)
    with pytest.raises(ValueError, match="change"):
        turns.turn_size(STATE, 0, 2)
    with pytest.raises(ValueError, match="hinges"):
        turns.motion_size(STATE, numbers[0] + 3, numbers[1])
    with pytest.raises(ValueError, match="changes"):
        turns.motion_size(STATE, numbers[0], numbers[1][:1].copy())
    with pytest.raises(ValueError, match="states"):
        turns.turn_table(np.array([STATE, STATE]), 1.0)
    with pytest.raises(ValueError, match="start"):
        turns.search(STATE, STATE[:3].copy(), SEARCH)
    for limits in (
        SEARCH._replace(together=4),
        SEARCH._replace(max_states=0),
        SEARCH._replace(max_work=-1),
        SEARCH._replace(size=1.5),
        SEARCH._replace(min_size=0.1),
    ):
        with pytest.raises(ValueError, match="search"):
            turns.search(STATE, STATE, limits)
    with pytest.raises(TypeError):
        turns.search(STATE.astype(float), STATE, SEARCH)


def test_the_first_states_of_a_table_are_those_given() -> None:
    table = JointTurns(CHAIN).turn_table(STATE[None], 1.0)
    assert (table.next == -1).all()
    assert (table.modules[..., 0] < table.modules[..., 1]).all()
    assert ((table.places >= 0.0) & (table.places <= 1.0)).all()
