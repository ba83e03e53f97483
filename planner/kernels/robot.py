"""One step of a robot around MuJoCo's part of it, compiled.

The state is changed in place; poses and velocities of all modules are those of ``chain_poses`` and
``chain_velocities``. Nothing here holds the interpreter, so that several robots step at once.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import INNER, KERNEL
from planner.kernels.kinematics import chain_poses, multiply
from planner.kernels.module import Joint
from planner.kernels.velocities import chain_velocities, cross, momentum_velocity

Array = NDArray[np.float64]
SLOW_RAD_S = 2e-3
"""Rate at which dry friction has three quarters of its strength: a hinge at rest is not stuck."""


@njit(**KERNEL, nogil=True)
def servo_torques(
    angles: Array,
    rates: Array,
    target: Array,
    target_rates: Array,
    ahead: Array,
    noise: Array,
    offsets: Array,
    encoder_rad: float,
    stiffness: float,
    damping: float,
    step_s: float,
    friction: Array,
    expected_friction: float,
    wanted: Array,
    rubbing: Array,
) -> None:
    """Writes what servos would give at the present angles, were those the step's end.

    Args:
        angles, rates: (J,) as they are.
        target, target_rates, ahead: (J,) angles, rates and torques for the step's end.
        noise, offsets: (J,) of the encoders, in radians.
        encoder_rad: Their steps; 0 for none.
        stiffness, damping: Of the servos.
        step_s: Time step.
        friction: (J,) largest torque of dry friction.
        expected_friction: What servos take it to be, and give beside the rest.
        wanted: (J,) written: torques.
        rubbing: (J,) written: friction's torque for each rad/s.
    """
    for j in range(angles.shape[0]):
        seen = angles[j] + noise[j]
        if encoder_rad > 0.0:
            seen = np.rint((seen + offsets[j]) / encoder_rad) * encoder_rad - offsets[j]
        # A hinge that sets out in this step is not held by what friction is at rest.
        speed = max(abs(rates[j]), abs(target_rates[j]))
        rubbing[j] = friction[j] * np.tanh(speed / SLOW_RAD_S) / max(speed, 1e-12)
        wanted[j] = (
            stiffness * (target[j] - seen - step_s * rates[j])
            + damping * (target_rates[j] - rates[j])
            + ahead[j]
            + expected_friction * np.tanh(target_rates[j] / SLOW_RAD_S)
        )


@njit(**KERNEL, nogil=True)
def advance(
    angles: Array,
    rates: Array,
    position: Array,
    rotation: Array,
    velocity: Array,
    spin: Array,
    hinges: Array,
    linear: Array,
    angular: Array,
    step_s: float,
    joint: Joint,
    root: int,
    positions: Array,
    rotations: Array,
    velocities: Array,
    spins: Array,
) -> bool:
    """Semi-implicit Euler: q̇ ← q̇ + h q̈, q ← q + h q̇; whether all is finite.

    Args:
        angles, rates: (J,) changed.
        position, rotation, velocity, spin: Of the root, as ``State`` has them; changed.
        hinges, linear, angular: (J,), (3,) and (3,) accelerations.
        step_s: h.
        joint, root: Of the chain.
        positions, rotations, velocities, spins: Of all modules; written.
    """
    sound = True
    for j in range(angles.shape[0]):
        rates[j] += step_s * hinges[j]
        angles[j] += step_s * rates[j]
        sound = sound and np.isfinite(angles[j])
    for r in range(3):
        velocity[r] += step_s * linear[r]
        spin[r] += step_s * angular[r]
        position[r] += step_s * velocity[r]
    turn = np.empty((3, 3))
    turn_by(spin, step_s, turn)
    before = rotation.copy()
    multiply(before, turn, rotation)
    world = np.zeros(3)
    for r in range(3):
        for c in range(3):
            world[r] += rotation[r, c] * spin[c]
    chain_poses(angles, joint, root, position, rotation, positions, rotations)
    chain_velocities(
        angles, rates, joint, root, velocity, world, positions, rotations, velocities, spins
    )
    return sound


@njit(**INNER)
def turn_by(spin: Array, seconds: float, out: Array) -> None:
    """Writes the (3, 3) rotation of a body that has spun for some time: Rodrigues' formula."""
    rate = np.sqrt(spin[0] ** 2 + spin[1] ** 2 + spin[2] ** 2)
    angle = rate * seconds
    # sin(a) / rate and (1 - cos(a)) / rate², also for a body that hardly spins.
    once = seconds if angle < 1e-8 else np.sin(angle) / rate
    twice = 0.5 * seconds * seconds if angle < 1e-4 else (1.0 - np.cos(angle)) / (rate * rate)
    x, y, z = spin[0], spin[1], spin[2]
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
def stop_drifting(
    masses: Array,
    inertia: Array,
    root: int,
    centre: Array,
    position: Array,
    rotation: Array,
    velocity: Array,
    spin: Array,
    positions: Array,
    rotations: Array,
    velocities: Array,
    spins: Array,
) -> None:
    """Takes the momentum of the whole chain away, and its centre of mass back to where it was.

    Args:
        masses: (n,) of the modules.
        inertia: (3,) of a module of mass 1.
        root: The root.
        centre: (3,) where the centre of mass was.
        position, rotation, velocity, spin: Of the root, as ``State`` has them; changed.
        positions, rotations, velocities, spins: Of all modules; changed.
    """
    found = momentum_velocity(masses, inertia, root, positions, rotations, velocities, spins)
    turn, now = found[1], found[2]
    still = found[0]
    arm = np.empty(3)
    side = np.empty(3)
    for i in range(positions.shape[0]):
        for r in range(3):
            arm[r] = positions[i, r] - positions[root, r]
        cross(turn, arm, side)
        for r in range(3):
            velocities[i, r] -= still[r] + side[r]
            spins[i, r] -= turn[r]
    for i in range(positions.shape[0]):
        for r in range(3):
            positions[i, r] += centre[r] - now[r]
    for r in range(3):
        position[r] = positions[root, r]
        velocity[r] = velocities[root, r]
        spin[r] = 0.0
        for c in range(3):
            spin[r] += rotation[c, r] * spins[root, c]
