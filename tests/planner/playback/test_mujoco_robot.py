"""Robots that MuJoCo itself simulates: their motion, their limits, and their certificates."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from foldback.planner.certificate.certificate import Certificate, certify
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.parameters.playback import PlaybackParameters, RobotParameters
from foldback.planner.playback import robot_runs
from foldback.planner.playback.playback import Playback, play_back
from foldback.planner.playback.reference_trajectory import ReferenceTrajectory
from foldback.planner.playback.robot_run import RobotRun, fold_with_robots
from foldback.planner.playback.robot_runs import mujoco_trajectory
from foldback.planner.playback.substeps import MAX_SERVO_SHARE
from foldback.planner.progress import never, silent
from foldback.planner.simulation.mujoco_robot import MujocoRobot, Substeps
from foldback.planner.simulation.robot import RobotErrors
from tests.planner.chains import coil
from tests.planner.conftest import Folded
from tests.planner.robot_errors import ERRORS, FAULTLESS


def trajectory_of(folded: Folded, robot: RobotParameters) -> ReferenceTrajectory:
    """Return the trajectory of a fold for such robots."""
    parameters = PlaybackParameters(robot=robot)
    return ReferenceTrajectory(folded.chain, folded.record, parameters, 0.95, 0.0, 1, None)


def run_of(folded: Folded, robot: RobotParameters) -> RobotRun:
    """Return the finished run of a robot in MuJoCo."""
    (run,) = fold_with_robots(divided_of(folded, robot), [[0, 0]], None, silent, never)
    return run


def divided_of(folded: Folded, robot: RobotParameters) -> ReferenceTrajectory:
    """Return the trajectory of a fold for such robots in MuJoCo."""
    trajectory = mujoco_trajectory(trajectory_of(folded, robot))
    assert trajectory is not None
    return trajectory


def test_robot_in_mujoco_moves_as_its_twin_but_not_by_the_same_code(folded: Folded) -> None:
    playback = folded.playback
    robots = np.stack([playback.frames.joint_angles_rad, *playback.others_rad])
    differences = np.abs(robots - playback.mujoco_rad).max(axis=(1, 2))
    assert differences.argmin() == playback.mujoco_robot
    # Encoders, whose noise differs, have steps of 2.4e-5 rad.
    assert 1e-7 < differences[playback.mujoco_robot] < 5e-5


def test_robot_without_errors_follows_exactly_also_in_divided_steps(folded: Folded) -> None:
    counts = list[int]()
    for robot in (FAULTLESS, replace(FAULTLESS, motor_limit=1.3)):
        run = run_of(folded, robot)
        assert run.status == "folded" and run.largest_error < 1e-12
        (steps,) = divided_of(folded, robot).substeps
        counts.append(max(len(step.rates) for step in steps))
    assert counts[0] < counts[1]


class WholeSteps(MujocoRobot):
    """Robot that leaves out no part of a step of MuJoCo."""

    def _integrate(self) -> None:
        mujoco.mj_fwdPosition(self.model, self.data)
        self._remove_momentum()
        mujoco.mj_fwdVelocity(self.model, self.data)
        mujoco.mj_step2(self.model, self.data)


@pytest.mark.parametrize(("part", "touches"), [(0.9, True), (0.1, False)])
def test_parts_of_a_step_that_are_left_out_have_no_effect(part: float, touches: bool) -> None:
    chain = coil(40)
    robots = [
        kind(
            chain,
            RobotErrors(chain, RobotParameters(), peak_torque=2e3, seed=[1]),
            geom_size=0.95,
            step_s=0.08,
        )
        for kind in (MujocoRobot, WholeSteps)
    ]
    constraints = 0
    targets = np.linspace(0.0 * chain.folded_rad, part * chain.folded_rad, 60)
    for robot in robots:
        robot.place(targets[0], np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
        for angles in targets:
            robot.follow([Substeps.still(angles, 0.08)])
            constraints += robot.data.nefc
    assert (constraints > 0) == touches
    # Where modules touch, MuJoCo's solver starts from accelerations of the last step before.
    tolerance = 1e-8 if constraints else 0.0
    states = [np.concatenate([robot.data.qpos, robot.data.qvel]) for robot in robots]
    np.testing.assert_allclose(states[0], states[1], rtol=0.0, atol=tolerance)


def test_divided_steps_keep_servos_within_their_limit(folded: Folded) -> None:
    robot = replace(FAULTLESS, motor_limit=1.3)
    trajectory = trajectory_of(folded, robot)
    limit = robot.motor_limit * trajectory.peak_torque
    damping = limit / robot.servo_give * robot.damping_s
    divided, count = trajectory.for_mujoco()
    (steps,) = divided.substeps
    rates = np.concatenate([step.rates for step in steps])
    torques = np.concatenate([step.torques for step in steps])
    changes = np.diff(rates, axis=0, prepend=0.0)
    assert np.abs(torques + damping * changes).max() <= MAX_SERVO_SHARE * limit
    assert count >= len(rates) > len(steps)
    # Each step still takes its time, and each part ends where the next one begins.
    _, reference, scaling = trajectory.curves[0]
    assert all(step.step_s * len(step.rates) == pytest.approx(scaling.step_s) for step in steps)
    starts = np.stack([step.angles[0] for step in steps])
    np.testing.assert_allclose(starts, reference.spline(scaling.u), atol=1e-12)
    ends = np.concatenate([step.angles + step.step_s * step.rates for step in steps])
    np.testing.assert_allclose(
        ends[:-1], np.concatenate([step.angles for step in steps])[1:], atol=1e-12
    )


def test_mujoco_limits_the_torques_of_motors(folded: Folded) -> None:
    kind = replace(FAULTLESS, motor_limit=0.6)
    trajectory = divided_of(folded, kind)
    errors = RobotErrors(folded.chain, kind, peak_torque=trajectory.peak_torque, seed=[0])
    weak = MujocoRobot(folded.chain, errors, geom_size=0.95, step_s=trajectory.step_s)
    weak.place(*trajectory.begins)
    largest = 0.0
    for step in trajectory.substeps[0]:
        weak.follow([step])
        largest = max(largest, float(np.abs(weak.data.qfrc_actuator).max()))
    assert 0.99 * errors.limit < largest <= errors.limit * (1.0 + 1e-12)


@pytest.mark.parametrize("name", ERRORS)
def test_mujoco_simulates_each_error(folded: Folded, name: str) -> None:
    run = run_of(folded, replace(FAULTLESS, **{name: ERRORS[name]}))
    assert run.status == "folded"
    assert 1e-6 < run.largest_error < 0.05


def test_simulation_that_takes_mujoco_too_long_is_left_out(
    folded: Folded, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot_runs, "MAX_MUJOCO_S", 1e-3)
    playback = play_back(folded.chain, folded.record, PlaybackParameters())
    assert (playback.mujoco_rad, playback.mujoco_robot) == (None, None)
    np.testing.assert_array_equal(playback.others_rad, folded.playback.others_rad)
    certificate = certify(folded.chain, folded.record, playback, Parameters())
    assert certificate.verified and certificate.mujoco_robot is None
    assert "mujoco_robot" not in certificate.as_dict()


def test_robot_in_mujoco_is_certified_and_refused_if_it_collides(folded: Folded) -> None:
    playback = folded.playback
    certificate = certify(folded.chain, folded.record, playback, Parameters())
    figures = certificate.mujoco_robot
    assert certificate.verified and figures is not None
    assert figures["robot"] == playback.mujoco_robot and len(certificate.robots) == 3
    assert 0.0 < figures["max_difference_rad"] < figures["max_angle_error_rad"] < 2e-4
    assert certificate.clearance_bound <= figures["clearance_bound"] <= figures["min_clearance"]
    assert Certificate.from_dict(certificate.as_dict()) == certificate
    collides, ends = playback.mujoco_rad.copy(), playback.mujoco_rad.copy()
    collides[len(collides) // 2, ::2] = 0.5 * np.pi
    ends[-1] *= 0.9
    lost = "the playbacks of the other simulated robots do not match the plan"
    for changes, words in (
        ({"mujoco_rad": collides}, "in the simulated playback in MuJoCo, modules"),
        ({"mujoco_rad": ends}, "the playback of another simulated robot ends"),
        ({"mujoco_rad": ends[1:]}, lost),
        ({"mujoco_rad": np.full_like(ends, np.nan)}, lost),
        ({"mujoco_robot": 3}, lost),
    ):
        refused: Playback = replace(playback, **changes)
        verdict = certify(folded.chain, folded.record, refused, Parameters()).verdict
        assert verdict.startswith(f"failed: {words}"), verdict
