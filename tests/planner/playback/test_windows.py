"""Robots that fold peeled chains: core and tail are rigid, and the window is simulated."""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.floating_torques import Floating, floating_torques
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import Record
from foldback.planner.parameters.playback import PlaybackParameters, RobotParameters
from foldback.planner.playback.playback import Playback, play_back
from foldback.planner.playback.window_trajectory import FRAME_RAD, WindowTrajectory
from foldback.planner.simulation.window_robot import RigidEnds, WindowRobot
from tests.planner.chains import Array
from tests.planner.mujoco_tree import tree_with
from tests.planner.peels import peel, snake
from tests.planner.robot_errors import FAULTLESS

SIZE = 0.3
"""Size of modules that touch nothing in an unchecked motion, pitches."""
UPRIGHT = (np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
FIRST, JOINTS = 30, 24
HINGES = slice(2 * FIRST, 2 * (FIRST + JOINTS))


@pytest.fixture(scope="module")
def chain() -> Chain:
    return snake((4, 4, 6))


@pytest.fixture(scope="module")
def peeled(chain: Chain) -> Motion:
    return peel(chain, width=24, step=1.0)


@pytest.mark.parametrize("stretch", [(FIRST, JOINTS), (0, JOINTS), (70, 24)], ids=str)
def test_torques_of_a_window_are_those_of_the_whole_chain(
    chain: Chain, stretch: tuple[int, int]
) -> None:
    first, joints = stretch
    hinges = slice(2 * first, 2 * (first + joints))
    rng = np.random.default_rng(1)
    motion = np.zeros((3, 1, len(chain.folded_rad)))
    motion[0, :, : hinges.start] = chain.folded_rad[: hinges.start]
    motion[:, :, hinges] = rng.normal(size=(3, 1, 2 * joints))
    lumps = RigidEnds(chain, np.ones(len(chain))).lumps(first + 1, first + 1 + joints)
    stretch = Floating(first=first + 1, lumps=lumps)
    computed_floating_torques = floating_torques(chain.module, *motion[:, :, hinges], stretch)
    whole_floating_torques = floating_torques(chain.module, *motion)
    np.testing.assert_allclose(
        computed_floating_torques,
        whole_floating_torques[:, hinges],
        atol=1e-9 * np.abs(whole_floating_torques).max(),
    )


def robot_of(chain: Chain, errors: RobotParameters, size: float = SIZE) -> WindowRobot:
    return WindowRobot(
        chain, errors, peak_torque=10.0, seed=[3], base=UPRIGHT, geom_size=size, step_s=0.08
    )


def test_step_agrees_with_a_mujoco_tree_whose_other_hinges_are_held(chain: Chain) -> None:
    robot = robot_of(chain, replace(FAULTLESS, mass_error=0.1, motor_limit=100.0))
    robot.take(FIRST, JOINTS)
    rng = np.random.default_rng(5)
    angles = chain.folded_rad[HINGES] * 0.0
    target, rates = 0.01 * rng.normal(size=(2, 2 * JOINTS))
    torques = rng.normal(size=2 * JOINTS)
    np.testing.assert_array_equal(robot.angles, angles)
    step = robot.step(target, rates, torques)
    h, errors = 0.08, robot.errors
    inertia = h * h * errors.stiffness + h * errors.damping
    model = tree_with(chain, SIZE, errors.masses)
    data: Any = mujoco.MjData(model)
    dofs = np.array([model.joint(name).dofadr[0] for name in chain.joint_names])
    folded_state = np.where(np.arange(len(dofs)) < HINGES.start, chain.folded_rad, 0.0)
    for name, angle in zip(chain.joint_names, folded_state, strict=True):
        data.joint(name).qpos[0] = angle
    model.dof_armature[dofs] = 1e12
    model.dof_armature[dofs[HINGES]] = inertia
    data.qfrc_applied[dofs[HINGES]] = errors.stiffness * target + errors.damping * rates + torques
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    expected = h * data.qacc[dofs[HINGES]]
    np.testing.assert_allclose(robot.angles, h * expected, atol=1e-7 * np.abs(h * expected).max())
    np.testing.assert_allclose(
        step,
        errors.stiffness * (target - robot.angles) + errors.damping * (rates - expected) + torques,
        atol=1e-6 * errors.limit,
    )


def test_window_touches_the_core_and_the_tail() -> None:
    chain = snake((4, 4, 6))

    def touching(first: int, angles: Array) -> set[tuple[int, int]]:
        robot = robot_of(chain, replace(FAULTLESS, mass_error=0.2), 0.95)
        robot.take(first, JOINTS)
        robot.state.angles[:] = angles
        robot.engine.place(robot.state)
        contacts = robot.find_contacts()
        pairs = [] if contacts is None else contacts.points.pairs.tolist()
        return {(min(pair), max(pair)) for pair in pairs}

    straight = np.zeros(2 * JOINTS)
    folded = chain.folded_rad[HINGES]
    assert not touching(FIRST, folded)  # all in their cells; the tail leads away
    backwards = folded.copy()
    backwards[:8] = -folded[:8]
    assert any(pair[0] == 0 for pair in touching(FIRST, backwards))
    # Modules that are not folded yet are not in the core, and the adjacent cube is no obstacle.
    assert not touching(0, straight)
    curled = straight.copy()
    curled[-8:] = np.tile([np.pi / 2, 0.0], 4)  # the tail returns along the window
    pairs = touching(0, curled)
    assert any(pair[1] == JOINTS for pair in pairs)
    assert not any(pair[0] == 0 for pair in pairs)


@pytest.fixture(scope="module")
def trajectory(chain: Chain, peeled: Motion) -> WindowTrajectory:
    return WindowTrajectory(chain, peeled, PlaybackParameters(), SIZE, 1)


def test_course_goes_from_straight_to_folded_without_a_jump(
    chain: Chain, peeled: Motion, trajectory: WindowTrajectory
) -> None:
    reference = trajectory.reference
    angles = reference.angles(chain)
    np.testing.assert_array_equal(angles[0], 0.0)
    np.testing.assert_allclose(angles[-1], chain.folded_rad, atol=1e-6)
    assert np.abs(np.diff(angles, axis=0)).max() <= 3.0 * FRAME_RAD
    # It deviates only at the corners between adjacent control points.
    passed = peeled.angles(chain)
    off = [np.abs(passed - row).max(axis=1).min() for row in angles]
    assert max(off) <= 2.0 * trajectory.parameters.spacing_rad
    assert len(trajectory.stretches) > 3
    assert [s.start for s in trajectory.stretches[1:]] == [
        s.stop for s in trajectory.stretches[:-1]
    ]


def play_back_with(chain: Chain, peeled: Motion, robot: RobotParameters) -> Playback:
    record = Record(
        status="straight",
        reason=None,
        frames=peeled,
        steps=len(peeled),
        seconds=0.0,
        strategy="peel",
    )
    return play_back(
        chain, record, PlaybackParameters(robot=robot), module_size=SIZE, start_s=5.0, seed=2
    )


def test_robot_without_faults_has_no_error(chain: Chain, peeled: Motion) -> None:
    playback = play_back_with(chain, peeled, FAULTLESS)
    assert (playback.status, playback.kind, playback.robots) == ("folded", "dynamic", None)
    assert playback.max_angle_error_rad < 2e-5  # the momentum that is removed at each step
    assert playback.frames.time_s[0] == 5.0
    frames = playback.frames.dense(chain)
    positions = frames.poses(chain).positions.mean(axis=1)[[0, 40, 90]]
    np.testing.assert_allclose(positions, positions[:1].repeat(3, axis=0), atol=5e-3)  # it floats


def test_weak_robot_loses_its_target(chain: Chain, peeled: Motion) -> None:
    playback = play_back_with(chain, peeled, replace(RobotParameters(), motor_limit=0.01, robots=1))
    assert playback.status == "missed"
    assert "a robot could not follow the motion" in str(playback.reason)
    frames = playback.frames
    assert frames.is_windowed
    assert len(frames) > 0
    # Each frame is measured against its own target, up to where tracking was lost.
    assert float(frames.errors.max()) <= (playback.max_angle_error_rad or 0.0)
