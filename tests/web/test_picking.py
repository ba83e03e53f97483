from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from planner.chain import Chain
from planner.modules import CUBE
from web.picking import picked_module

FAR = np.array([3.0, 5.0, 7.0])


def test_a_ray_at_a_module_meets_it_or_one_before_it(chain: Chain) -> None:
    poses = chain.folded_poses
    for index, centre in enumerate(poses.positions):
        origin = centre + np.array([0.0, 0.0, 10.0])
        met = picked_module(CUBE, poses.positions, poses.wxyzs, origin, np.array([0.0, 0.0, -1.0]))
        assert met == index


def test_the_nearer_of_two_in_a_row_is_met() -> None:
    positions = np.array([[0.0, 0, 0], [2.0, 0, 0]])
    wxyzs = np.tile([1.0, 0, 0, 0], (2, 1))
    ray = np.array([-1.0, 0.0, 0.0])
    assert picked_module(CUBE, positions, wxyzs, np.array([5.0, 0.1, 0.1]), ray) == 1
    assert picked_module(CUBE, positions, wxyzs, np.array([-5.0, 0.1, 0.1]), -ray) == 0


def test_what_lies_behind_or_beside_is_not_met() -> None:
    positions, wxyzs = np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]])
    origin = np.array([0.0, 0.0, 3.0])
    assert picked_module(CUBE, positions, wxyzs, origin, np.array([0.0, 0.0, 1.0])) is None
    beside = origin + [0.51, 0.0, 0.0]
    assert picked_module(CUBE, positions, wxyzs, beside, np.array([0.0, 0.0, -1.0])) is None


@given(st.floats(0.0, 2 * np.pi))
def test_a_turned_cube_reaches_as_far_as_its_hull(turn: float) -> None:
    wxyzs = np.array([[np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)]])
    corner = np.array([np.cos(turn + np.pi / 4), np.sin(turn + np.pi / 4), 0.0]) / np.sqrt(2)
    down = np.array([0.0, 0.0, -1.0])
    for share, met in ((0.99, 0), (1.01, None)):
        origin = corner * share + np.array([0.0, 0.0, 4.0])
        assert picked_module(CUBE, np.zeros((1, 3)), wxyzs, origin, down) == met
