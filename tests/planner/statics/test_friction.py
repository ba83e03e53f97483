"""Friction with the floor: known results for a dragged tail, with the base clamped and free."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.chain.rotations import wxyz_from_matrix
from foldback.planner.statics.balance import Balance
from foldback.planner.statics.friction import (
    CONE_SIDES,
    DIRECTION_SPREADS_RAD,
    Friction,
    rays,
    slip_displacements,
    with_estimated_drift,
)
from tests.planner.chains import line
from tests.planner.statics.standing import by_joint_wrenches, imbalance, standing

STEP = 1e-3


def drag_tail(chain: Chain, coefficient: float, root: int = 0, step: float = STEP) -> Friction:
    """Return the friction of a straight chain that turns a vertical hinge; ``root`` is fixed."""
    angles = chain.folded_rad.copy()
    angles[0] += step
    poses = forward_kinematics(
        chain.module,
        angles,
        root=root,
        root_position=chain.folded_poses.positions[root] + [0.0, 0.0, 0.5],
        root_wxyz=wxyz_from_matrix(chain.folded_poses.rotations[root]),
    )
    return Friction(coefficient=coefficient, positions=poses.positions, rotations=poses.rotations)


@pytest.mark.parametrize("coefficient", [0.1, 0.3])
def test_torque_of_one_dragged_module(coefficient: float) -> None:
    # The horizontal hinge carries a part of it; the rest stands on one far corner, r = √(1.5² +
    # 0.5²) from the hinge. There the floor exerts μ N 0.5 / r towards the front, half a pitch below
    # that hinge: (1.5 + μ 0.25 / r) N = 1 − t, and t = μ r N.
    chain = line(3)
    at = standing(chain)
    friction = drag_tail(chain, coefficient)
    solution = Balance(chain).solve(*at, friction=friction, clamped=0)
    reach = np.hypot(1.5, 0.5)
    lever = reach / (1.5 + coefficient * 0.25 / reach)
    assert solution.torque == pytest.approx(
        coefficient * lever / (1.0 + coefficient * lever), rel=1e-4
    )


def test_torque_of_a_dragged_tail_agrees_with_joint_wrenches() -> None:
    coefficient = 0.1
    torques = []
    for beyond in (4, 8):
        chain = line(beyond + 2)
        at = standing(chain)
        friction = drag_tail(chain, coefficient)
        solution = Balance(chain).solve(*at, friction=friction, clamped=0)
        expected = by_joint_wrenches(chain, *at, solution.contacts, friction, 0)
        assert solution.torque == pytest.approx(expected, rel=1e-4)
        torques.append(solution.torque)
        # less than if each module dragged by itself: horizontal hinges carry a part
        assert solution.torque < coefficient * sum(np.hypot(j, 0.5) for j in range(1, beyond + 1))
        assert solution.torque > coefficient * beyond**2 / 4
    assert 3.0 < torques[1] / torques[0] < 4.0


def test_corner_at_rest_is_held_within_the_friction_cone() -> None:
    chain = line(4)
    positions, rotations, angles = standing(chain)
    solution = Balance(chain).solve(positions, rotations, angles)
    friction = drag_tail(chain, 0.5)
    chosen_contacts, forces = rays(solution.contacts, friction, positions, rotations)
    moved = slip_displacements(solution.contacts, friction, positions, rotations)
    still = solution.contacts.first < 2
    assert (np.linalg.norm(moved, axis=1) == 0.0).tolist() == still.tolist()
    assert len(chosen_contacts) == CONE_SIDES * still.sum() + (~still).sum()
    assert np.hypot(forces[:, 0], forces[:, 1]) == pytest.approx(np.full(len(chosen_contacts), 0.5))
    slipping = ~still[chosen_contacts]
    along = moved[chosen_contacts[slipping]]
    assert ((along * forces[slipping, :2]).sum(axis=1) < 0.0).all()


def test_free_chain_drifts_with_the_least_friction() -> None:
    chain = line(6)
    positions, rotations, angles = standing(chain)
    solution = Balance(chain).solve(positions, rotations, angles)
    friction = drag_tail(chain, 0.3)
    pressures = np.full(solution.contacts.on_floor.sum(), 0.25)

    def work(first_friction: Friction) -> float:
        ways = slip_displacements(solution.contacts, first_friction, positions, rotations)
        return float(np.linalg.norm(ways, axis=1) @ pressures)

    free = with_estimated_drift(solution.contacts, friction, positions, rotations, pressures)
    assert work(free) < work(friction)
    rng = np.random.default_rng(0)
    assert free.positions is not None and free.fan == DIRECTION_SPREADS_RAD[0]
    for _ in range(20):
        shift = np.append(rng.normal(scale=0.1 * STEP, size=2), 0.0)
        other_settings = replace(free, positions=free.positions + shift)
        assert work(free) <= work(other_settings) * (1.0 + 1e-2)


def test_free_chain_balances_while_it_drifts() -> None:
    chain = line(6)
    at = standing(chain)
    balance = Balance(chain)
    clamped = balance.solve(*at, friction=drag_tail(chain, 0.3), clamped=0).torque
    for root in (0, 5):  # the fixed module does not matter
        solution = balance.solve(*at, friction=drag_tail(chain, 0.3, root))
        assert 0.0 < solution.torque <= clamped
        assert imbalance(chain, at[0], solution) < 1e-4


def test_friction_holds_a_chain_that_leans_outwards() -> None:
    # Feet of an upturned V slide apart without friction.
    chain = line(6)
    angles = np.zeros(len(chain.folded_rad))
    angles[3] = 1.0  # the horizontal hinge of the second joint
    poses = forward_kinematics(chain.module, angles)
    turn = Rotation.from_euler("y", -0.5).as_matrix()
    if (poses.positions @ turn.T)[2, 2] < (poses.positions @ turn.T)[0, 2]:
        turn = turn.T
    positions, rotations = poses.positions @ turn.T, turn @ poses.rotations
    corners = chain.module.pieces[0].corners @ np.swapaxes(rotations, 1, 2) + positions[:, None]
    positions = positions - [0.0, 0.0, corners[..., 2].min()]
    smooth = Balance(chain, floor_gap=1.0).solve(positions, rotations, angles)
    rough = Balance(chain, floor_gap=1.0).solve(
        positions, rotations, angles, friction=Friction(coefficient=1.0)
    )
    assert rough.balances and rough.torque < smooth.torque
