"""One step of a robot: the torques of its servos, and the integration of its state, compiled.

States are changed in place. Nothing here holds the interpreter, so that several robots step at
once.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL
from foldback.planner.kernels.articulated import Accelerations
from foldback.planner.kernels.kinematics import chain_poses, cross, multiply, vector
from foldback.planner.kernels.module import ChainModel, ModuleStates, ReducedState
from foldback.planner.kernels.velocities import chain_velocities, equivalent_rigid_velocity

Array = NDArray[np.float64]
FRICTION_SPEED_RAD_S = 2e-3
"""Joint speed v₀, rad/s, in the model of dry friction, torque ∝ tanh(speed / v₀)."""


class RobotServos(NamedTuple):
    """Position servos of J hinges. Torques are in module mass · pitch² / s².

    Attributes:
        offsets: (J,) offsets of the encoders, in rad.
        friction: (J,) largest torques of dry friction.
        encoder_rad: Resolution of the encoders; 0 for none.
        stiffness: kp, torque per rad.
        damping: kv, torque per rad/s.
        expected_friction: Dry friction that the servos compensate.
    """

    offsets: Array
    friction: Array
    encoder_rad: float
    stiffness: float
    damping: float
    expected_friction: float


class ServoTarget(NamedTuple):
    """Setpoint of J servos for the end of a step.

    Attributes:
        q, qd: (J,) hinge angles and rates.
        feedforward: (J,) torques that a robot without errors needs for them.
    """

    q: Array
    qd: Array
    feedforward: Array


@njit(**KERNEL, nogil=True)
def servo_torques(
    q: Array,
    qd: Array,
    target: ServoTarget,
    noise: Array,
    servos: RobotServos,
    step_s: float,
    commanded: Array,
    friction_damping: Array,
) -> None:
    """Write the torques of servos as if the present angles were those at the end of the step.

    τ = kp (q* − q_measured − h q̇) + kv (q̇* − q̇) + τ_feedforward + τ_friction.

    Args:
        q, qd: (J,) present hinge angles and rates.
        target: Setpoint for the end of the step.
        noise: (J,) noise of the encoders, in rad.
        servos: The servos.
        step_s: Time step h.
        commanded: (J,) written: torques.
        friction_damping: (J,) written: torque of dry friction per rad/s.
    """
    for j in range(q.shape[0]):
        measured = q[j] + noise[j]
        if servos.encoder_rad > 0.0:
            steps = np.rint((measured + servos.offsets[j]) / servos.encoder_rad)
            measured = steps * servos.encoder_rad - servos.offsets[j]
        # The larger of both rates: static friction must not hold a hinge that starts to move.
        speed = max(abs(qd[j]), abs(target.qd[j]))
        saturated = np.tanh(speed / FRICTION_SPEED_RAD_S)
        friction_damping[j] = servos.friction[j] * saturated / max(speed, 1e-12)
        commanded[j] = (
            servos.stiffness * (target.q[j] - measured - step_s * qd[j])
            + servos.damping * (target.qd[j] - qd[j])
            + target.feedforward[j]
            + servos.expected_friction * np.tanh(target.qd[j] / FRICTION_SPEED_RAD_S)
        )


@njit(**KERNEL, nogil=True)
def advance(
    state: ReducedState,
    accelerations: Accelerations,
    step_s: float,
    stop_rad: float,
    model: ChainModel,
    modules: ModuleStates,
) -> bool:
    """Integrate by semi-implicit Euler: q̇ ← q̇ + h q̈, q ← q + h q̇; hinges halt at their stops.

    Args:
        state: Changed.
        accelerations: Accelerations at the beginning of the step.
        step_s: Time step h.
        stop_rad: Angle of the stops, either way.
        model: Inertial parameters of the chain.
        modules: Written: poses and velocities of all modules.

    Returns:
        True if all hinge angles are finite.
    """
    is_finite = True
    omega, alpha = state.angular_velocity, accelerations.root
    for j in range(state.q.shape[0]):
        state.qd[j] += step_s * accelerations.qdd[j]
        state.q[j] += step_s * state.qd[j]
        is_finite = is_finite and np.isfinite(state.q[j])
        if abs(state.q[j]) > stop_rad:
            state.q[j] = np.copysign(stop_rad, state.q[j])
            state.qd[j] = 0.0
    for r in range(3):
        state.velocity[r] += step_s * accelerations.root[3 + r]
        for c in range(3):
            omega[r] += step_s * state.rotation[c, r] * alpha[c]
        state.position[r] += step_s * state.velocity[r]
    step = np.empty((3, 3))
    integrate_rotation(omega, step_s, step)
    before = state.rotation.copy()
    multiply(before, step, state.rotation)
    write_modules(state, model, modules)
    return is_finite


@njit(**KERNEL, nogil=True)
def write_modules(state: ReducedState, model: ChainModel, modules: ModuleStates) -> None:
    """Write poses and velocities of all modules of a state.

    Args:
        state: State of the chain.
        model: Inertial parameters of the chain.
        modules: Written.
    """
    joint, root = model.joint, model.root
    world = np.zeros(3)
    for r in range(3):
        for c in range(3):
            world[r] += state.rotation[r, c] * state.angular_velocity[c]
    chain_poses(
        state.q, joint, root, state.position, state.rotation, modules.positions, modules.rotations
    )
    chain_velocities(state.q, state.qd, joint, root, state.velocity, world, modules)


@njit(**INNER)
def integrate_rotation(omega: Array, seconds: float, out: Array) -> None:
    """Write the (3, 3) rotation of a body that turns at a constant ω: Rodrigues' formula."""
    rate = np.sqrt(omega[0] ** 2 + omega[1] ** 2 + omega[2] ** 2)
    angle = rate * seconds
    # sin(a) / rate and (1 − cos(a)) / rate², by their limits where the angle is tiny.
    once = seconds if angle < 1e-8 else np.sin(angle) / rate
    twice = 0.5 * seconds * seconds if angle < 1e-4 else (1.0 - np.cos(angle)) / (rate * rate)
    x, y, z = omega[0], omega[1], omega[2]
    out[0, 0] = 1.0 - twice * (y * y + z * z)
    out[0, 1] = twice * x * y - once * z
    out[0, 2] = twice * x * z + once * y
    out[1, 0] = twice * x * y + once * z
    out[1, 1] = 1.0 - twice * (x * x + z * z)
    out[1, 2] = twice * y * z - once * x
    out[2, 0] = twice * x * z - once * y
    out[2, 1] = twice * y * z + once * x
    out[2, 2] = 1.0 - twice * (x * x + y * y)


@njit(**KERNEL, nogil=True)
def remove_net_momentum(
    model: ChainModel, centre: Array, state: ReducedState, modules: ModuleStates
) -> None:
    """Remove momentum and angular momentum of a free chain, and restore its centre of mass.

    Args:
        model: Inertial parameters of the chain.
        centre: (3,) centre of mass to restore.
        state: State of the chain; the root's part is changed.
        modules: Poses and velocities of all modules; changed.
    """
    positions, _, velocities, omega = modules
    root = model.root
    drift, turning, present = equivalent_rigid_velocity(model, modules)
    arm = np.empty(3)
    for i in range(positions.shape[0]):
        for r in range(3):
            arm[r] = positions[i, r] - positions[root, r]
        orbital = cross(vector(turning), vector(arm))
        for r in range(3):
            velocities[i, r] -= drift[r] + orbital[r]
            omega[i, r] -= turning[r]
    for i in range(positions.shape[0]):
        for r in range(3):
            positions[i, r] += centre[r] - present[r]
    for r in range(3):
        state.position[r] = positions[root, r]
        state.velocity[r] = velocities[root, r]
        state.angular_velocity[r] = 0.0
        for c in range(3):
            state.angular_velocity[r] += state.rotation[c, r] * omega[root, c]
