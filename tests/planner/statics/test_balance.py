"""Minimal largest torque: known values, and agreement with a second formulation."""

import numpy as np
import pytest

from foldback.planner.chain.built_in_modules import TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.statics.balance import Balance
from foldback.planner.statics.stable_poses import resting_poses
from tests.planner.chains import chain_of, coil, line, random_angles
from tests.planner.statics.standing import by_joint_wrenches, imbalance, standing


def test_flat_or_upright_chain_needs_no_torque() -> None:
    chain = line(7)
    solution = Balance(chain).solve(*standing(chain))
    assert solution.torque == 0.0
    assert solution.contacts.standing.tolist() == list(range(7))
    tower = chain_of([(0, 0, z) for z in range(6)])
    assert Balance(tower).solve(*standing(tower)).torque == 0.0


@pytest.mark.parametrize("beyond", [1, 5])
def test_torque_of_a_cantilever(beyond: int) -> None:
    # The link from module 0 to 1 is rigid, so that the first hinge is at the centre of module 1;
    # the modules beyond it are 1, 2, … k pitches from there.
    chain = line(beyond + 2)
    solution = Balance(chain).solve(*standing(chain, lift=5.0), clamped=0)
    assert solution.torque == pytest.approx(beyond * (beyond + 1) / 2)
    assert len(solution.contacts) == 0
    # clamped at its other end, where the link is not rigid
    solution = Balance(chain).solve(*standing(chain, lift=5.0), clamped=beyond + 1)
    assert solution.torque == pytest.approx(beyond * (beyond + 1) / 2)


def test_chain_in_the_air_or_beyond_the_rim_is_unbalanced() -> None:
    chain = line(4)
    solution = Balance(chain).solve(*standing(chain, lift=5.0))
    assert not solution.balances
    assert np.isnan(solution.torques).all()
    # One module stands; the centre of mass is 1.2 pitches from its centre.
    tips = chain_of([(0, 0, 0), (0, 0, 1), (1, 0, 1), (2, 0, 1), (3, 0, 1)])
    balance = Balance(tips)
    assert not balance.solve(*standing(tips)).balances
    assert balance.solve(*standing(tips), clamped=0).torque == pytest.approx(1 + 2 + 3)


def test_within_and_enough_bound_the_torque() -> None:
    chain = chain_of([(0, 0, 0), *((x, 0, 1) for x in range(5)), (4, 0, 0)])
    balance = Balance(chain)
    at = standing(chain)
    assert balance.within(1.001, *at)
    assert not balance.within(0.999, *at)
    assert imbalance(chain, at[0], balance.solve(*at)) < 1e-4
    assert 1.0 - 1e-6 < balance.solve(*at, enough=1.5).torque <= 1.5 + 1e-6


def _lay_down(chain: Chain, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    poses = forward_kinematics(chain.module, angles)
    pose = next(resting_poses(chain.module, poses.positions, poses.rotations))
    return *pose.of(poses.positions, poses.rotations), angles


@pytest.mark.parametrize("seed", [0, 3, 4, 5])
def test_torque_agrees_with_joint_wrenches(seed: int) -> None:
    rng = np.random.default_rng(seed)
    chain = coil(12)
    angles = chain.folded_rad + rng.normal(scale=0.004, size=len(chain.folded_rad))
    if seed % 2:
        angles[12:] = random_angles(chain, rng, 0.6)[12:]
    at = _lay_down(chain, angles)
    clamped = 0 if seed > 3 else None
    solution = Balance(chain).solve(*at, clamped=clamped)
    expected = by_joint_wrenches(chain, *at, solution.contacts, clamped=clamped)
    assert solution.torque == pytest.approx(expected, rel=1e-4, abs=0.011)
    assert solution.contacts.on_floor.sum() >= 3


def test_previous_solutions_change_no_result() -> None:
    chain = coil(12)
    rng = np.random.default_rng(0)
    going = Balance(chain)
    distance = rng.normal(scale=0.01, size=len(chain.folded_rad))
    distance[:12] = 0.0
    for share in (0.0, 0.2, 0.4, 5.0, 5.1, 0.3):
        at = _lay_down(chain, chain.folded_rad + share * distance)
        afresh = Balance(chain).solve(*at).torque
        assert going.solve(*at).torque == pytest.approx(afresh, rel=1e-4, abs=0.011)


@pytest.mark.parametrize("seed", range(3))
def test_torque_of_tetrahedra_agrees_with_joint_wrenches(seed: int) -> None:
    rng = np.random.default_rng(seed)
    chain = Chain.from_angles(TETRAHEDRON, np.zeros(7))
    angles = rng.uniform(-1.0, 1.0, 7)
    if seed == 2:
        angles[:3] = np.pi / 2  # face to face
    at = _lay_down(chain, angles)
    solution = Balance(chain).solve(*at)
    expected = by_joint_wrenches(chain, *at, solution.contacts)
    assert solution.torque == pytest.approx(expected, rel=1e-4)
    assert np.isfinite(expected)
