"""Kernels of chains whose joints differ from module to module, against plain NumPy and MuJoCo."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from foldback.planner.chain.rotations import wxyz_from_matrix
from foldback.planner.core import (
    BODY_COLUMNS,
    DISPLACEMENT_BOUND,
    ROTATION,
    VELOCITY,
    chain_poses,
    chain_velocities,
    constrained_accelerations,
    many_floating_torques,
    move_bodies,
    near_pairs,
)
from foldback.planner.core.structures import (
    NO_CONTACTS,
    Accelerations,
    ArticulatedBodies,
    ChainModel,
    Joint,
    Loads,
    Lumps,
    ModuleStates,
    ReducedState,
)
from foldback.planner.simulation.lazy_mujoco import mujoco
from tests.planner.chains import Array, random_rotation

MODULES = 9


def table(hinges: int, seed: int = 1) -> Joint:
    """Return joints of three kinds that follow each other in a pattern of five."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(3, hinges, 3))
    return Joint(
        rigid_links=1,
        first=0,
        kinds=np.array([0, 2, 1, 1, 2]),
        anchor=rng.uniform(-0.4, 0.4, (3, 3)),
        axes=axes / np.linalg.norm(axes, axis=2, keepdims=True),
        turn=np.array([random_rotation(rng) for _ in range(3)]),
        offset=rng.uniform(-0.9, 0.9, (3, 3)),
    )


def plain_poses(joint: Joint, q: Array, modules: int = MODULES) -> list[tuple[Array, Array]]:
    """Return centres and orientations of modules by the formula of a link, module 0 upright."""
    position, rotation = np.zeros(3), np.eye(3)
    poses = [(position, rotation)]
    hinge = 0
    for i in range(modules - 1):
        row = joint.kinds[(joint.first + i) % len(joint.kinds)]
        position = position + rotation @ joint.anchor[row]
        for axis in joint.axes[row] if i >= joint.rigid_links else ():
            rotation = rotation @ Rotation.from_rotvec(axis * q[hinge]).as_matrix()
            hinge += 1
        rotation = rotation @ joint.turn[row]
        position = position + rotation @ joint.offset[row]
        poses.append((position, rotation))
    return poses


def states_of(joint: Joint, state: ReducedState, root: int, modules: int = MODULES) -> ModuleStates:
    """Return poses and velocities of all modules by the kernels."""
    out = ModuleStates.empty(modules)
    ends = (state.position, state.rotation)
    chain_poses(state.q, joint, root, *ends, out.positions, out.rotations)
    spin = state.rotation @ state.angular_velocity
    chain_velocities(state.q, state.qd, joint, root, state.velocity, spin, out)
    return out


def random_state(joint: Joint, seed: int, modules: int = MODULES) -> ReducedState:
    """Return a moving state of a chain."""
    rng = np.random.default_rng(seed)
    hinges = joint.hinges * (modules - 1 - joint.rigid_links)
    q, qd = rng.uniform(-2.0, 2.0, hinges), rng.normal(size=hinges)
    return ReducedState(q, qd, rng.normal(size=3), random_rotation(rng), *rng.normal(size=(2, 3)))


@pytest.mark.parametrize("hinges", [1, 2])
@pytest.mark.parametrize("root", [0, 4, 8])
def test_poses_follow_the_formula_of_each_link(hinges: int, root: int) -> None:
    joint = table(hinges)
    state = random_state(joint, 2)
    expected = plain_poses(joint, state.q)
    at_root = expected[root]
    poses = ModuleStates.empty(MODULES)
    chain_poses(state.q, joint, root, *at_root, poses.positions, poses.rotations)
    np.testing.assert_allclose(poses.positions, [p for p, _ in expected], atol=1e-12)
    np.testing.assert_allclose(poses.rotations, [r for _, r in expected], atol=1e-12)


def test_a_window_has_the_joints_of_its_place_in_the_chain() -> None:
    joint = table(2)
    q = random_state(joint, 3).q
    whole = plain_poses(joint, q)
    first, count = 3, 5
    window = joint.window(first)
    hinges = slice(2 * (first - 1), 2 * (first + count - 2))
    poses = ModuleStates.empty(count)
    chain_poses(q[hinges], window, 0, *whole[first], poses.positions, poses.rotations)
    for k in range(count):
        np.testing.assert_allclose(poses.positions[k], whole[first + k][0], atol=1e-12)
        np.testing.assert_allclose(poses.rotations[k], whole[first + k][1], atol=1e-12)


@pytest.mark.parametrize("hinges", [1, 2])
def test_velocities_are_the_derivatives_of_poses(hinges: int) -> None:
    joint = table(hinges)
    state = random_state(joint, 4)
    moving = states_of(joint, state, root=4)
    step = 1e-6

    def moved(seconds: float) -> ModuleStates:
        turn = Rotation.from_rotvec(seconds * state.angular_velocity).as_matrix()
        position = state.position + seconds * state.velocity
        later = ReducedState(
            state.q + seconds * state.qd, state.qd, position, state.rotation @ turn, *state[4:]
        )
        return states_of(joint, later, root=4)

    before, after = moved(-step), moved(step)
    speed = (after.positions - before.positions) / (2.0 * step)
    np.testing.assert_allclose(moving.velocities, speed, atol=1e-7)
    spin = (after.rotations - before.rotations) / (2.0 * step) @ moving.rotations.swapaxes(1, 2)
    np.testing.assert_allclose(moving.angular_velocities[:, 0], spin[:, 2, 1], atol=1e-7)


MOMENTS = np.array([[0.1, 0.2, 0.25], [0.3, 0.3, 0.15], [0.05, 0.12, 0.1]])


def mujoco_tree(joint: Joint, masses: Array) -> Any:
    """Return a free chain as one MuJoCo tree from module 0 on, each module a body."""
    spec = mujoco.MjSpec()
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.compiler.degree = False
    body = spec.worldbody.add_body()
    body.add_freejoint()
    for i, mass in enumerate(masses):
        row = joint.kinds[i % len(joint.kinds)]
        if i:
            before = joint.kinds[(i - 1) % len(joint.kinds)]
            turn, offset = joint.turn[before], joint.offset[before]
            body = body.add_body()
            body.pos = joint.anchor[before] + turn @ offset
            body.quat = wxyz_from_matrix(turn)
            for axis in joint.axes[before] if i > joint.rigid_links else ():
                hinge = body.add_joint()
                hinge.type = mujoco.mjtJoint.mjJNT_HINGE
                hinge.pos, hinge.axis = -offset, turn.T @ axis
        body.explicitinertial, body.mass, body.inertia = True, mass, mass * MOMENTS[row]
        body.ipos, body.iquat = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]
    return spec.compile()


def accelerations_by_mujoco(
    joint: Joint, masses: Array, state: ReducedState, torques: Array
) -> Array:
    """Return the accelerations of the hinges of a chain whose root is module 0."""
    model = mujoco_tree(joint, masses)
    data: Any = mujoco.MjData(model)
    data.qpos[:] = [*state.position, *wxyz_from_matrix(state.rotation), *state.q]
    data.qvel[:] = [*state.velocity, *state.angular_velocity, *state.qd]
    data.qfrc_applied[6:] = torques
    mujoco.mj_forward(model, data)
    return data.qacc[6:]


def accelerations(
    joint: Joint, masses: Array, state: ReducedState, torques: Array, stops: Array
) -> Array:
    """Return the accelerations of the hinges by the articulated-body algorithm."""
    model = ChainModel(joint, masses, MOMENTS, Lumps.none(), False, 0)
    modules = states_of(joint, state, root=0)
    out = Accelerations(np.empty(len(state.q)), np.empty(6))
    loads = Loads(torques, np.zeros(len(torques)), np.zeros((MODULES, 3)), np.zeros(3))
    bodies = ArticulatedBodies.zeros(MODULES, joint.hinges)
    assert constrained_accelerations(model, state, loads, modules, NO_CONTACTS, stops, bodies, out)
    return out.qdd


@pytest.mark.parametrize("hinges", [1, 2])
def test_dynamics_of_modules_that_differ_agree_with_mujoco(hinges: int) -> None:
    joint = table(hinges)
    rng = np.random.default_rng(5)
    masses, state = rng.uniform(0.5, 2.0, MODULES), random_state(joint, 6)
    torques = rng.normal(size=len(state.q))
    free = np.tile([-np.inf, np.inf], (len(torques), 1))
    computed = accelerations(joint, masses, state, torques, free)
    expected = accelerations_by_mujoco(joint, masses, state, torques)
    np.testing.assert_allclose(computed, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("hinges", [1, 2])
def test_inverse_dynamics_undoes_dynamics(hinges: int) -> None:
    joint = table(hinges)
    rng = np.random.default_rng(7)
    state, torques = random_state(joint, 8), rng.normal(size=7 * hinges)
    at_rest = state._replace(qd=np.zeros_like(state.q), velocity=np.zeros(3))
    at_rest = at_rest._replace(angular_velocity=np.zeros(3))
    free = np.tile([-np.inf, np.inf], (len(torques), 1))
    masses = rng.uniform(0.5, 2.0, MODULES)
    computed = accelerations(joint, masses, at_rest, torques, free)
    out = np.empty((1, len(torques)))
    motion = (at_rest.q[None], at_rest.qd[None], computed[None])
    model = ChainModel(joint, masses, MOMENTS, Lumps.none(), False, 0)
    many_floating_torques(*motion, model, out)
    np.testing.assert_allclose(out[0], torques, atol=1e-9)


def test_each_hinge_has_stops_of_its_own() -> None:
    joint = table(1)
    state, torques = random_state(joint, 9), np.zeros(7)
    free = np.tile([-np.inf, np.inf], (7, 1))
    moving = accelerations(joint, np.ones(MODULES), state, torques, free)
    for hinge in range(7):
        for side in (-1.0, 1.0):
            stops = free.copy()
            stops[hinge, int(side > 0.0)] = state.q[hinge]
            stopped = accelerations(joint, np.ones(MODULES), state, torques, stops)
            if side * moving[hinge] > 0.0:  # it pushes outwards, and is held
                assert abs(stopped[hinge]) < 1e-6
            else:
                np.testing.assert_array_equal(stopped, moving)


@pytest.mark.parametrize("root", [0, 4, 8])
@pytest.mark.parametrize("hinges", [1, 2])
def test_bounds_of_a_motion_hold_between_its_moments(hinges: int, root: int) -> None:
    joint, half = table(hinges), 0.5
    state = random_state(joint, 10)
    rates = 0.3 * state.qd
    bodies = np.zeros((MODULES, BODY_COLUMNS))
    bodies[root, ROTATION:VELOCITY] = np.eye(3).ravel()
    move_bodies(state.q, rates, half, joint, root, bodies)
    for moment in np.linspace(-half, half, 41):
        poses = ModuleStates.empty(MODULES)
        q = state.q + moment * rates
        chain_poses(q, joint, root, np.zeros(3), np.eye(3), poses.positions, poses.rotations)
        moved = np.linalg.norm(poses.positions - bodies[:, :ROTATION], axis=1)
        assert (moved <= bodies[:, DISPLACEMENT_BOUND] + 1e-12).all()
        if moment == 0.0:
            np.testing.assert_allclose(moved, 0.0, atol=1e-12)


def test_links_longer_than_a_pitch_hide_no_near_pairs() -> None:
    rng = np.random.default_rng(11)
    for _ in range(20):
        points = np.cumsum(rng.normal(size=(30, 3)) * rng.uniform(1.0, 40.0), axis=0)
        gaps = np.linalg.norm(points[:, None] - points, axis=2)
        expected = np.argwhere((gaps < 2.0) & np.triu(np.ones((30, 30), bool), 2))
        np.testing.assert_array_equal(near_pairs(points, 2.0, 2), expected)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("kinds", np.array([0, 3]), "rows of the table"),
        ("kinds", np.array([1]), "row 0"),
        ("kinds", np.zeros(0, np.int64), "period"),
        ("first", -1, "not negative"),
        ("turn", np.zeros((2, 3, 3)), r"\(T, 3, 3\)"),
    ],
)
def test_a_wrong_table_is_refused(name: str, value: object, message: str) -> None:
    joint = table(1)._replace(**{name: value})
    out = ModuleStates.empty(3)
    with pytest.raises(ValueError, match=message):
        chain_poses(np.zeros(1), joint, 0, np.zeros(3), np.eye(3), out.positions, out.rotations)
