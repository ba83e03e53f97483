"""Turns by the hinges' own steps: their sizes, against poses in between, and searches for them."""

import numpy as np
import pytest

from foldback.planner.chain.built_in_modules import module_named
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.core import SIZE_TOLERANCE, least_separation
from foldback.planner.core.structures import Levels
from foldback.planner.errors import InputError
from foldback.planner.turns.hinge_steps import HingeSteps
from foldback.planner.twist_chains.figures import snake_figures

PRISM = module_named("snake-prism")
LIGHTSABRE = "00000220000"
BENT = "1230132"


def levels(code: str) -> Levels:
    return np.array([int(digit) for digit in code], np.int8)


def least_between(before: Levels, change: Levels, size: float, samples: int = 240) -> float:
    """Return the least separation of all modules at some places on the way, by another kernel."""
    count = len(before) + 1
    pairs = np.array([(i, j) for j in range(count) for i in range(j)], np.int64)
    least = np.inf
    for share in np.linspace(0.0, 1.0, samples + 1):
        poses = forward_kinematics(PRISM, np.pi / 2 * (before + share * change))
        apart = least_separation(poses.positions, poses.rotations, pairs, PRISM.hull, size, 1.0)
        least = min(least, apart[0])
    return least


def test_all_known_figures_lie_on_the_lattice_and_are_free() -> None:
    steps = HingeSteps(PRISM, 24)
    for figure in snake_figures():
        state = np.array(figure.code.digits, np.int8)
        assert steps.resting_size(state)[0] > 1.0 - 1e-9, figure.name
        chain = Chain.from_angles(PRISM, np.pi / 2 * state.astype(float))
        corners = np.einsum("nij,vj->nvi", chain.folded_poses.rotations, PRISM.pieces[0].corners)
        corners += chain.folded_poses.positions[:, None]
        corners = corners.reshape(-1, 3)
        extents = sorted(np.rint(np.ptp(_on_axes(corners), axis=0)).tolist())
        assert extents == sorted(figure.cells), figure.name


def _on_axes(corners: np.ndarray) -> np.ndarray:
    """Return points turned so that the edges of the first prism lie along the axes."""
    x, y = corners[2] - corners[0], corners[4] - corners[0]
    axes = np.stack([x, y, np.cross(x, y)]) / np.linalg.norm(x)
    return corners @ axes.T


def test_overlapping_figures_name_two_modules() -> None:
    size, first, second = HingeSteps(PRISM, 6).resting_size(levels("02220"))
    assert size < 0.9
    assert 0 <= first < second <= 5


@pytest.mark.parametrize("code", [LIGHTSABRE, BENT])
def test_sizes_of_turns_are_those_at_which_modules_touch(code: str) -> None:
    steps, state = HingeSteps(PRISM, len(code) + 1), levels(code)
    limited = 0
    for hinge in range(len(code)):
        for direction in (-1, 1):
            size, first, second, place = steps.turn_size(state, hinge, direction)
            change = np.zeros_like(state)
            change[hinge] = direction
            if size > 0.5:
                assert least_between(state, change, size - 2 * SIZE_TOLERANCE) > 0.0
            if size < 1.0:
                limited += 1
                poses = forward_kinematics(PRISM, np.pi / 2 * (state + place * change))
                pair = np.array([[first, second]], np.int64)
                larger = least_separation(
                    poses.positions, poses.rotations, pair, PRISM.hull, size + 1e-6, 1.0
                )
                assert first <= hinge < second
                assert larger[0] < 0.0
    assert limited >= 2


def test_sizes_of_turns_at_once_are_those_at_which_modules_touch() -> None:
    steps, state = HingeSteps(PRISM, 5), levels("0220")
    size = steps.motion_size(state, np.array([1, 2]), np.array([-1, 1]))
    change = np.array([0, -1, 1, 0], np.int8)
    assert 0.5 < size < 1.0
    assert least_between(state, change, size - 2 * SIZE_TOLERANCE) > 0.0
    assert least_between(state, change, size + 2e-3, samples=2000) < 0.0


def test_one_turn_alone_has_the_same_size_as_a_motion() -> None:
    steps, state = HingeSteps(PRISM, len(BENT) + 1), levels(BENT)
    for hinge in range(len(BENT)):
        turn = steps.turn_size(state, hinge, 1)[0]
        motion = steps.motion_size(state, np.array([hinge]), np.array([1]))
        assert max(motion, 0.5) == pytest.approx(max(turn, 0.5), abs=2 * SIZE_TOLERANCE)


def test_angles_of_a_way_go_on_over_a_full_turn_and_end_small() -> None:
    way = np.array([[2, 3], [3, 3], [0, 3], [0, 0]], np.int8)
    quarters = HingeSteps(PRISM, 3).angles(way) / (np.pi / 2)
    np.testing.assert_allclose(quarters, [[-2, -1], [-1, -1], [0, -1], [0, 0]], atol=1e-12)


def test_levels_have_no_full_turns_and_angles_between_steps_are_refused() -> None:
    steps = HingeSteps(PRISM, 3)
    assert steps.levels(np.deg2rad([-90.0, 720.0])).tolist() == [3, 0]
    with pytest.raises(InputError, match=r"got an angle of 45.0° at hinge 2"):
        steps.levels(np.deg2rad([0.0, 45.0]))


def test_stops_limit_the_levels_of_tetrahedra() -> None:
    steps = HingeSteps(module_named("tetrahedron"), 3)
    search = steps.search(np.array([1, -1], np.int8), np.zeros(2, np.int8), max_states=100)
    assert search.reached
    assert steps.search(np.zeros(2, np.int8), np.array([2, 0], np.int8), max_states=100).exhausted


def test_a_search_reduces_the_size_to_the_largest_that_leads_on() -> None:
    steps, goal = HingeSteps(PRISM, 5), np.zeros(4, np.int8)
    locked = steps.search(levels("0220"), goal, max_states=1000)
    assert (locked.reached, locked.exhausted, locked.count) == (False, True, 1)
    smaller = steps.search(levels("0220"), goal, min_size=0.5, max_states=1000)
    assert smaller.reached
    assert 0.5 < smaller.size < locked.next_size < 1.0
    above = steps.search(levels("0220"), goal, size=smaller.size + 1e-3, max_states=1000)
    assert above.exhausted
