"""Robots with model errors: their properties, their folding, and their certificates."""

from dataclasses import fields, replace
from typing import Any

import mujoco
import numpy as np
import pytest

from foldback.planner.arrays import Array, Ints
from foldback.planner.certificate.certificate import Certificate, certify
from foldback.planner.chain.built_in_modules import CUBE, TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.core import robot_steps
from foldback.planner.core.structures import (
    ModuleStates,
    ReducedState,
    RobotStates,
    ServoTargets,
)
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.parameters.playback import PlaybackParameters, RobotParameters
from foldback.planner.playback.playback import Playback, play_back
from foldback.planner.simulation.robot import RobotTeam
from tests.planner.chains import coil, line, unvalidated
from tests.planner.conftest import Folded
from tests.planner.mujoco_tree import tree_with
from tests.planner.robot_errors import ERRORS, FAULTLESS


def play(folded: Folded, robot: RobotParameters, **options: Any) -> Playback:
    """Play back the record of a fold with such robots."""
    parameters = PlaybackParameters(robot=robot)
    return play_back(folded.chain, folded.record, parameters, **options)


@pytest.mark.parametrize("chain", [line(7), coil(40)], ids=len)
def test_step_agrees_with_a_mujoco_tree_of_the_same_masses(chain: Chain) -> None:
    parameters = replace(FAULTLESS, mass_error=0.1, motor_limit=100.0)
    team = RobotTeam(chain, parameters, peak_torque=10.0, seeds=[[3]], geom_size=0.3, step_s=0.08)
    errors = team.robots[0].errors
    assert errors.masses.std() > 0.05
    hinges = len(chain.folded_rad)
    rng = np.random.default_rng(5)
    angles = 0.6 * chain.folded_rad + 0.1 * rng.normal(size=hinges)
    team.place(angles, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    target, rates = angles + 0.001 * rng.normal(size=hinges), 0.01 * rng.normal(size=hinges)
    torques = rng.normal(size=hinges)
    states = team.follow(ServoTargets(target[None], rates[None], torques[None])).states
    h, stiffness = 0.08, errors.limit / FAULTLESS.servo_give
    damping = stiffness * FAULTLESS.damping_s
    model = tree_with(chain, 0.3, errors.masses)
    data: Any = mujoco.MjData(model)
    dofs = [model.joint(name).dofadr[0] for name in chain.joint_names]
    for name, angle in zip(chain.joint_names, angles, strict=True):
        data.joint(name).qpos[0] = angle
    model.dof_armature[dofs] = h * h * stiffness + h * damping
    data.qfrc_applied[dofs] = stiffness * (target - angles) + damping * rates + torques
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    expected = h * data.qacc[dofs]
    end_angles, end_rates = states.q[0, 1], states.qd[0, 1]
    np.testing.assert_allclose(end_rates, expected, atol=1e-9 * np.abs(expected).max())
    # The servo's torque depends on the state at the end of the step, as in an implicit scheme.
    arguments = stiffness * (target - end_angles) + damping * (rates - end_rates) + torques
    np.testing.assert_allclose(states.torques[0, 0], arguments, rtol=1e-6, atol=1e-6 * errors.limit)


class CountingTeam(RobotTeam):
    """Team that counts the steps that robots make by themselves."""

    steps = 0

    def _make_step(
        self, number: int, targets: ServoTargets, noise: Array, states: RobotStates, made: Ints
    ) -> None:
        self.steps += 1
        super()._make_step(number, targets, noise, states, made)


class SteppedTeam(CountingTeam):
    """Team whose robots make each step by themselves, with MuJoCo's contacts."""

    def _make_steps(
        self, targets: ServoTargets, noise: Array, states: RobotStates, made: Ints
    ) -> None:
        del targets, noise, states, made


def straight_team(
    kind: type[RobotTeam], chain: Chain, limit: float, seeds: tuple[int, ...] = (3,)
) -> RobotTeam:
    """Return straight robots whose motors have a largest torque."""
    parameters = RobotParameters(motor_limit=1.0)
    team = kind(
        chain,
        parameters,
        peak_torque=limit,
        seeds=[[seed] for seed in seeds],
        geom_size=0.95,
        step_s=0.08,
    )
    team.place(np.zeros(len(chain.folded_rad)), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    return team


def targets_towards(goal: Array) -> ServoTargets:
    """Return the targets of 60 steps from straight to a goal."""
    angles = np.linspace(np.zeros_like(goal), goal, 60)
    return ServoTargets(angles, np.gradient(angles, 0.08, axis=0), np.zeros_like(angles))


BENT_TETRAHEDRA = unvalidated(TETRAHEDRON, np.full(6, 1.02 * TETRAHEDRON.largest_angle_rad))
BENT_CUBES = unvalidated(CUBE, np.full(12, 1.02 * CUBE.largest_angle_rad))


@pytest.mark.parametrize(
    ("chain", "limit"),
    [(coil(40), 2e3), (BENT_CUBES, 1e3), (BENT_TETRAHEDRA, 1e3)],
    ids=["cubes that touch", "cubes at their stops", "tetrahedra at their stops"],
)
def test_steps_of_a_team_are_those_of_each_robot_by_itself(chain: Chain, limit: float) -> None:
    seeds = (3, 4, 5, 6, 7)  # more than a vector has lanes
    team = straight_team(CountingTeam, chain, limit, seeds)
    targets = targets_towards(chain.folded_rad)
    states = team.follow(targets).states
    for number, seed in enumerate(seeds[::2]):
        alone = straight_team(SteppedTeam, chain, limit, (seed,)).follow(targets).states
        for name, arrays in alone._asdict().items():
            np.testing.assert_array_equal(getattr(states, name)[2 * number], arrays[0], name)
    assert (np.abs(states.torques) >= limit).any(), "saturated motors"
    assert isinstance(team, CountingTeam)
    assert 0 < team.steps < len(seeds) * (len(targets.q) - 10), "steps of both kinds"


def test_states_that_are_not_finite_end_a_robot_and_no_other() -> None:
    chain = coil(40)
    targets = targets_towards(0.1 * chain.folded_rad)
    team = straight_team(CountingTeam, chain, 1e3, (3, 4))
    team.body.servos.offsets[1, 7] = np.nan
    team.robots[1].errors.offsets[7] = np.nan
    followed = team.follow(targets)
    assert followed.made.tolist() == [60, 0]
    assert list(followed.broken) == [1]
    assert "infinite or undefined" in str(followed.broken[1])
    assert team.follow(targets).made.tolist() == [60, 0]


def test_robot_that_has_ended_makes_no_more_steps() -> None:
    chain = coil(40)
    targets = targets_towards(0.1 * chain.folded_rad)
    team = straight_team(RobotTeam, chain, 1e3, (3, 4))
    team.end(0)
    followed = team.follow(targets)
    assert followed.made.tolist() == [0, 60] and not followed.broken


def test_wrong_calls_of_the_compiled_loop_are_errors() -> None:
    team = straight_team(RobotTeam, line(7), 1e3, (3, 4))
    targets, body = targets_towards(np.zeros(10)), team.body
    state, modules = (
        type(arrays)(*(np.stack([array] * 2) for array in arrays))
        for arrays in (
            ReducedState(
                np.zeros(10), np.zeros(10), np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3)
            ),
            team.robots[0].engine.modules,
        )
    )
    made, states = np.zeros(2, dtype=np.int64), RobotStates.empty(2, 60, 10)
    right = (body, targets, np.zeros((2, 60, 10)), state, modules, states, made)
    robot_steps(*right)
    assert made.tolist() == [60, 60]
    for place, wrong in (
        (0, body._replace(masses=np.ones((2, 5)))),
        (0, body._replace(size=0.0)),
        (0, body._replace(root=7)),
        (0, body._replace(centres=np.zeros((2, 2)))),
        (0, body._replace(lumps=body.lumps._replace(masses=np.zeros((1, 2))))),
        (0, body._replace(servos=body.servos._replace(offsets=np.zeros((2, 9))))),
        (1, targets._replace(qd=np.zeros((59, 10)))),
        (2, np.zeros((2, 60, 9))),
        (3, state._replace(q=np.zeros((2, 9)))),
        (4, ModuleStates(*(array[:1] for array in modules))),
        (5, RobotStates.empty(2, 59, 10)),
        (6, np.array([0, -1])),
    ):
        with pytest.raises(ValueError, match=": "):
            robot_steps(*(wrong if k == place else right[k] for k in range(7)))


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
