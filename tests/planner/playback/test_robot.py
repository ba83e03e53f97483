"""Robots with model errors: their properties, their folding, and their certificates."""

from dataclasses import fields, replace
from typing import Any

import mujoco
import numpy as np
import pytest

from foldback.planner.certificate.certificate import Certificate, certify
from foldback.planner.chain.chain import Chain
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.parameters.playback import PlaybackParameters, RobotParameters
from foldback.planner.playback.playback import Playback, play_back
from foldback.planner.simulation.contact_finder import robot_contacts
from foldback.planner.simulation.robot import Robot
from tests.planner.chains import coil, line
from tests.planner.conftest import Folded
from tests.planner.mujoco_tree import tree_with
from tests.planner.robot_errors import ERRORS, FAULTLESS


def play(folded: Folded, robot: RobotParameters, **options: Any) -> Playback:
    """Play back the record of a fold with such robots."""
    parameters = PlaybackParameters(robot=robot)
    return play_back(folded.chain, folded.record, parameters, **options)


@pytest.mark.parametrize("chain", [line(7), coil(40)], ids=len)
def test_step_agrees_with_a_mujoco_tree_of_the_same_masses(chain: Chain) -> None:
    contacts = robot_contacts(chain, geom_size=0.3, step_s=0.08)
    contacts.allocate(len(chain))
    parameters = replace(FAULTLESS, mass_error=0.1, motor_limit=100.0)
    robot = Robot(chain, contacts, parameters, peak_torque=10.0, seed=[3], step_s=0.08)
    assert robot.errors.masses.std() > 0.05
    hinges = len(chain.folded_rad)
    rng = np.random.default_rng(5)
    angles = 0.6 * chain.folded_rad + 0.1 * rng.normal(size=hinges)
    robot.place(angles, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    target, rates = angles + 0.001 * rng.normal(size=hinges), 0.01 * rng.normal(size=hinges)
    torques = rng.normal(size=hinges)
    robot.follow(target, rates, torques)
    robot.end_step()
    h, stiffness = 0.08, robot.errors.limit / FAULTLESS.servo_give
    damping = stiffness * FAULTLESS.damping_s
    model = tree_with(chain, 0.3, robot.errors.masses)
    data: Any = mujoco.MjData(model)
    dofs = [model.joint(name).dofadr[0] for name in chain.joint_names]
    for name, angle in zip(chain.joint_names, angles, strict=True):
        data.joint(name).qpos[0] = angle
    model.dof_armature[dofs] = h * h * stiffness + h * damping
    data.qfrc_applied[dofs] = stiffness * (target - angles) + damping * rates + torques
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    expected = h * data.qacc[dofs]
    np.testing.assert_allclose(robot.rates, expected, atol=1e-9 * np.abs(expected).max())
    # The servo's torque depends on the state at the end of the step, as in an implicit scheme.
    arguments = stiffness * (target - robot.angles) + damping * (rates - robot.rates) + torques
    np.testing.assert_allclose(
        robot.motor_torques, arguments, rtol=1e-6, atol=1e-6 * robot.errors.limit
    )


def test_each_fault_is_seen_in_the_joint_error(folded: Folded) -> None:
    exact = play(folded, FAULTLESS)
    assert exact.status == "folded"
    assert exact.max_angle_error_rad < 1e-12
    assert (exact.robots, exact.others_rad) == (None, None)
    for name, value in ERRORS.items():
        faulty = play(folded, replace(FAULTLESS, **{name: value}))
        assert faulty.status == "folded", name
        assert 2.0 * exact.max_angle_error_rad < faulty.max_angle_error_rad < 0.05, name


def test_all_errors_of_robots_are_tried() -> None:
    own_settings = {"robots", "motor_limit", "servo_give", "damping_s", "engine"}
    assert {field.name for field in fields(RobotParameters)} == own_settings | ERRORS.keys(), (
        "add a value of the new error to tests/planner/robot_errors.py"
    )


def test_seed_decides_the_robots_and_the_largest_error_is_shown(folded: Folded) -> None:
    first = folded.playback
    repeated_play, second = (play(folded, RobotParameters(), seed=seed) for seed in (0, 1))
    np.testing.assert_array_equal(repeated_play.others_rad, first.others_rad)
    np.testing.assert_array_equal(
        repeated_play.frames.joint_angles_rad, first.frames.joint_angles_rad
    )
    assert not np.array_equal(second.frames.joint_angles_rad, first.frames.joint_angles_rad)
    reference = first.reference_rad
    np.testing.assert_array_equal(second.reference_rad, reference)
    assert first.robots == RobotParameters().robots == 3
    assert first.others_rad.shape == (2, *reference.shape)
    largest_error_rad = np.abs(first.frames.joint_angles_rad - reference).max()
    assert all(
        np.abs(other_angles_rad - reference).max() < largest_error_rad + 1e-12
        for other_angles_rad in first.others_rad
    )
    assert (
        first.max_angle_error_rad >= largest_error_rad - 1e-6
    )  # angles are stored in steps of that size


def test_motors_keep_their_torque_limit(folded: Folded) -> None:
    need = play(folded, FAULTLESS).peak_torque
    weak = play(folded, replace(FAULTLESS, motor_limit=0.9))
    assert need is not None and weak.peak_torque is not None
    assert weak.peak_torque <= 0.91 * need


def test_each_robot_is_certified_and_refused_if_it_collides(folded: Folded) -> None:
    playback = folded.playback
    certificate = certify(folded.chain, folded.record, playback, Parameters())
    assert certificate.verified and len(certificate.robots) == 3
    assert certificate.robots[0]["min_clearance"] == certificate.min_clearance_playback
    bounds = [robot["clearance_bound"] for robot in certificate.robots]
    assert certificate.clearance_bound <= min(bounds)
    assert Certificate.from_dict(certificate.as_dict()) == certificate
    collides, ends = playback.others_rad.copy(), playback.others_rad.copy()
    collides[1, len(collides[1]) // 2, ::2] = 0.5 * np.pi  # around a square, again and again
    ends[0, -1] *= 0.9
    lost = "the playbacks of the other simulated robots do not match the plan"
    for other_limits, words in (
        (collides, "in the simulated playback of robot 2, modules"),
        (ends, "the playback of another simulated robot ends"),
        (playback.others_rad[:, 1:], lost),
        (np.full_like(ends, np.nan), lost),
    ):
        computed_certificate = certify(
            folded.chain, folded.record, replace(playback, others_rad=other_limits), Parameters()
        )
        assert computed_certificate.verdict.startswith(f"failed: {words}")
