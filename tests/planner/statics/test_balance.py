"""The smallest largest torque: known truths, and the same by a second formulation."""

from __future__ import annotations

import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.chain.kinematics import forward_kinematics
from planner.chain.module import TETRAHEDRON
from planner.statics.balance import Balance
from planner.statics.friction import rays
from planner.statics.stable_poses import resting_poses
from tests.planner.chains import coil, line, random_angles
from tests.planner.statics.standing import by_joint_wrenches, out_of_balance, standing, through


def test_what_lies_on_the_floor_asks_nothing() -> None:
    chain = line(7)
    found = Balance(chain).solve(*standing(chain))
    assert found.torque == 0.0
    assert found.contacts.standing.tolist() == list(range(7))


@pytest.mark.parametrize("beyond", [1, 2, 5, 9])
def test_a_cantilever(beyond: int) -> None:
    # The link from module 0 to 1 is rigid, so that the first hinge is in the middle of module 1;
    # the modules behind it are 1, 2, … k pitches from there.
    chain = line(beyond + 2)
    found = Balance(chain).solve(*standing(chain, lift=5.0), clamped=0)
    assert found.torque == pytest.approx(beyond * (beyond + 1) / 2)
    assert len(found.contacts) == 0


def test_a_cantilever_from_its_middle_or_its_end() -> None:
    chain = line(9)
    from_middle = Balance(chain).solve(*standing(chain, lift=5.0), clamped=4)
    # Forwards the hinge is in the clamped module itself, with four modules behind it; backwards in
    # module 3, with three before it.
    assert from_middle.torque == pytest.approx(4 * 5 / 2)
    from_end = Balance(chain).solve(*standing(chain, lift=5.0), clamped=8)
    assert from_end.torque == pytest.approx(7 * 8 / 2)


def test_nothing_balances_in_the_air_or_beyond_the_rim() -> None:
    chain = line(4)
    found = Balance(chain).solve(*standing(chain, lift=5.0))
    assert not found.balances
    assert np.isnan(found.torques).all()
    # One module stands, the centre of mass is 1.2 pitches from its middle.
    tips = through([(0, 0, 0), (0, 0, 1), (1, 0, 1), (2, 0, 1), (3, 0, 1)])
    balance = Balance(tips)
    assert not balance.solve(*standing(tips)).balances
    assert balance.solve(*standing(tips), clamped=0).torque == pytest.approx(1 + 2 + 3)


def test_a_tower_stands() -> None:
    chain = through([(0, 0, z) for z in range(6)])
    assert Balance(chain).solve(*standing(chain)).torque == 0.0


@pytest.mark.parametrize("half", [1, 2])
def test_a_bridge_between_two_supports(half: int) -> None:
    # Feet at x = 0 and L = 2m bear N = (L + 3) / 2 each, e inside of the middle of their module:
    # torque N e in the legs and m² / 2 − N e in the middle of the beam, both m² / 4 at best.
    length = 2 * half
    cells = [(0, 0, 0), *((x, 0, 1) for x in range(length + 1)), (length, 0, 0)]
    chain = through(cells)
    positions, rotations, angles = standing(chain)
    found = Balance(chain).solve(positions, rotations, angles)
    assert found.torque == pytest.approx(half**2 / 4)
    assert out_of_balance(chain, positions, found) < 1e-4


def test_an_answer_that_is_enough_comes_sooner_and_no_larger() -> None:
    chain = through([(0, 0, 0), *((x, 0, 1) for x in range(5)), (4, 0, 0)])
    balance = Balance(chain)
    at = standing(chain)
    assert balance.within(1.001, *at)
    assert not balance.within(0.999, *at)
    assert 1.0 - 1e-6 < balance.solve(*at, enough=1.5).torque <= 1.5 + 1e-6


def _laid(chain: Chain, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    poses = forward_kinematics(chain.module, angles)
    pose = next(resting_poses(chain.module, poses.positions, poses.rotations))
    return *pose.of(poses.positions, poses.rotations), angles


@pytest.mark.parametrize("seed", range(6))
def test_the_same_by_joint_wrenches(seed: int) -> None:
    rng = np.random.default_rng(seed)
    chain = coil(12)
    angles = chain.folded_rad + rng.normal(scale=0.004, size=len(chain.folded_rad))
    if seed % 2:
        angles[12:] = random_angles(chain, rng, 0.6)[12:]
    positions, rotations, angles = _laid(chain, angles)
    clamped = 0 if seed > 3 else None
    found = Balance(chain).solve(positions, rotations, angles, clamped=clamped)
    which, forces = rays(found.contacts, None, positions, rotations)
    expected = by_joint_wrenches(
        chain, positions, rotations, angles, found.contacts, which, forces, clamped
    )
    assert found.torque == pytest.approx(expected, rel=1e-4, abs=0.011)
    assert found.contacts.on_floor.sum() >= 3


def test_what_was_found_last_changes_no_answer() -> None:
    chain = coil(12)
    rng = np.random.default_rng(0)
    going = Balance(chain)
    away = rng.normal(scale=0.01, size=len(chain.folded_rad))
    away[:12] = 0.0
    for share in (0.0, 0.2, 0.4, 5.0, 5.1, 0.3):
        at = _laid(chain, chain.folded_rad + share * away)
        afresh = Balance(chain).solve(*at).torque
        assert going.solve(*at).torque == pytest.approx(afresh, rel=1e-4, abs=0.011)


def test_tetrahedra() -> None:
    # The first hinge of the straight chain lies level: k modules behind it, from half a pitch on.
    beyond = 5
    chain = Chain.from_angles(TETRAHEDRON, np.zeros(beyond))
    poses = chain.folded_poses
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    positions = poses.positions @ turn.T + [0.0, 0.0, 9.0]
    rotations = turn @ poses.rotations
    found = Balance(chain).solve(positions, rotations, chain.folded_rad, clamped=0)
    assert found.torque == pytest.approx(beyond**2 / 2)


@pytest.mark.parametrize("seed", range(3))
def test_tetrahedra_by_joint_wrenches(seed: int) -> None:
    rng = np.random.default_rng(seed)
    chain = Chain.from_angles(TETRAHEDRON, np.zeros(7))
    angles = rng.uniform(-1.0, 1.0, 7)
    if seed == 2:
        angles[:3] = np.pi / 2  # face to face
    positions, rotations, angles = _laid(chain, angles)
    found = Balance(chain).solve(positions, rotations, angles)
    which, forces = rays(found.contacts, None, positions, rotations)
    expected = by_joint_wrenches(chain, positions, rotations, angles, found.contacts, which, forces)
    assert found.torque == pytest.approx(expected, rel=1e-4)
    assert np.isfinite(expected)
