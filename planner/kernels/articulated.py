"""Forward dynamics of a free chain that touches nothing, compiled: linear in its modules.

Featherstone's articulated-body algorithm (Rigid Body Dynamics Algorithms, 2008, chapter 7), with
all vectors in the world's frame and each module's taken at its centre: the wrench that the joint
before module j gives it is A_j a_j + b_j, where a_j holds its angular and linear acceleration, A_j
is its articulated inertia, (6, 6), and b_j what does not depend on accelerations.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels.dynamics import joint_axes
from planner.kernels.module import Joint
from planner.kernels.velocities import cross

Array = NDArray[np.float64]


@njit(cache=True)
def _alone(rotation: Array, inertia: Array, spin: Array, force: Array, a: Array, b: Array) -> None:
    """Writes A and b of a module of mass 1 that nothing hangs on."""
    a[:] = 0.0
    for r in range(3):
        for c in range(3):
            for k in range(3):
                a[r, c] += rotation[r, k] * inertia[k] * rotation[c, k]
        a[3 + r, 3 + r] = 1.0
    momentum = np.zeros(3)
    for r in range(3):
        for c in range(3):
            momentum[r] += a[r, c] * spin[c]
    cross(spin, momentum, b[:3])
    for r in range(3):
        b[3 + r] = -force[r]


@njit(cache=True)
def _centripetal(spin: Array, arm: Array, out: Array) -> None:
    """Adds ω × (ω × arm) to ``out``."""
    along = spin[0] * arm[0] + spin[1] * arm[1] + spin[2] * arm[2]
    square = spin[0] * spin[0] + spin[1] * spin[1] + spin[2] * spin[2]
    for r in range(3):
        out[r] += spin[r] * along - arm[r] * square


@njit(cache=True)
def _add_shifted(a: Array, b: Array, r: Array, a_out: Array, b_out: Array) -> None:
    """Adds Tᵀ A T and Tᵀ b for a module whose parent's centre is −r from its own.

    T is the map of accelerations (α, p̈) to (α, p̈ + α × r).
    """
    work = a.copy()
    for row in range(6):
        # A T: of the angular columns, the linear ones times −[r]×.
        x, y, z = a[row, 3], a[row, 4], a[row, 5]
        work[row, 0] += r[1] * z - r[2] * y
        work[row, 1] += r[2] * x - r[0] * z
        work[row, 2] += r[0] * y - r[1] * x
    for column in range(6):
        x, y, z = work[3, column], work[4, column], work[5, column]
        work[0, column] += r[1] * z - r[2] * y
        work[1, column] += r[2] * x - r[0] * z
        work[2, column] += r[0] * y - r[1] * x
    a_out += work
    x, y, z = b[3], b[4], b[5]
    b_out[0] += b[0] + r[1] * z - r[2] * y
    b_out[1] += b[1] + r[2] * x - r[0] * z
    b_out[2] += b[2] + r[0] * y - r[1] * x
    for k in range(3, 6):
        b_out[k] += b[k]


@njit(cache=True)
def _solved(d: Array, u: Array) -> tuple[float, float]:
    """D⁻¹ u for one or two hinges."""
    if u.shape[0] == 1:
        return u[0] / d[0, 0], 0.0
    whole = d[0, 0] * d[1, 1] - d[0, 1] * d[1, 0]
    return (
        (d[1, 1] * u[0] - d[0, 1] * u[1]) / whole,
        (d[0, 0] * u[1] - d[1, 0] * u[0]) / whole,
    )


@njit(cache=True)
def free_accelerations(
    angles: Array,
    rates: Array,
    torques: Array,
    forces: Array,
    joint: Joint,
    inertia: Array,
    armature: float,
    root: int,
    positions: Array,
    rotations: Array,
    spins: Array,
    hinges_out: Array,
    root_out: Array,
) -> None:
    """Writes the (J,) hinge accelerations and (6,) the root's, angular first, in the world.

    Args:
        angles, rates, torques: (J,) of the hinges.
        forces: (n, 3) at the centres, in the world.
        joint, inertia: Of the module, whose mass is 1.
        armature: Rotor inertia of a hinge.
        root: The module whose acceleration is wanted.
        positions, rotations, spins: Of all modules, in the world.
        hinges_out, root_out: Where to write.
    """
    rigid_links, anchor, axes = joint.rigid_links, joint.anchor, joint.axes
    n = positions.shape[0]
    hinges = axes.shape[0]
    a = np.empty((n, 6, 6))
    b = np.empty((n, 6))
    c = np.zeros((n, 6))
    s = np.zeros((n, hinges, 6))
    us = np.zeros((n, hinges, 6))
    d = np.zeros((n, hinges, hinges))
    u = np.zeros((n, hinges))
    spin = np.empty(3)
    arm = np.empty(3)
    work = np.empty(3)
    without = np.empty((6, 6))
    bias = np.empty(6)
    for i in range(n):
        _alone(rotations[i], inertia, spins[i], forces[i], a[i], b[i])
    for i in range(n - 1, 0, -1):
        j = (i - 1 - rigid_links) * hinges
        for r in range(3):
            arm[r] = 0.0
            for k in range(3):
                arm[r] += rotations[i - 1, r, k] * anchor[k]
        _centripetal(spins[i - 1], arm, c[i, 3:])
        for r in range(3):
            arm[r] = positions[i, r] - positions[i - 1, r] - arm[r]
        _centripetal(spins[i], arm, c[i, 3:])
        if j >= 0:
            joint_axes(rotations[i - 1], axes, angles[j : j + hinges], s[i, :, :3])
            spin[:] = spins[i - 1]
            for h in range(hinges):
                cross(spin, s[i, h, :3], work)
                for r in range(3):
                    c[i, r] += work[r] * rates[j + h]
                    spin[r] += s[i, h, r] * rates[j + h]
                cross(s[i, h, :3], arm, s[i, h, 3:])
            cross(c[i, :3], arm, work)
            for r in range(3):
                c[i, 3 + r] += work[r]
        for row in range(6):
            bias[row] = b[i, row]
            for k in range(6):
                bias[row] += a[i, row, k] * c[i, k]
        without[:] = a[i]
        if j >= 0:
            for h in range(hinges):
                u[i, h] = torques[j + h]
                for row in range(6):
                    u[i, h] -= s[i, h, row] * bias[row]
                    for k in range(6):
                        us[i, h, row] += a[i, row, k] * s[i, h, k]
            for h in range(hinges):
                d[i, h, h] = armature
                for g in range(hinges):
                    for row in range(6):
                        d[i, h, g] += s[i, h, row] * us[i, g, row]
            for k in range(6):
                x, y = _solved(d[i], us[i, :, k])
                for row in range(6):
                    without[row, k] -= us[i, 0, row] * x
                    if hinges == 2:
                        without[row, k] -= us[i, 1, row] * y
            for row in range(6):
                for k in range(row):  # rounding would grow from module to module
                    without[row, k] = without[k, row]
            x, y = _solved(d[i], u[i])
            for row in range(6):
                bias[row] += us[i, 0, row] * x
                if hinges == 2:
                    bias[row] += us[i, 1, row] * y
        for r in range(3):
            arm[r] = positions[i, r] - positions[i - 1, r]
        _add_shifted(without, bias, arm, a[i - 1], b[i - 1])
    if not np.isfinite(b[0]).all() or not np.isfinite(a[0]).all():
        hinges_out[:] = np.nan
        return
    moved: Array = np.linalg.solve(a[0], -b[0])  # pyright: ignore[reportAssignmentType]
    if root == 0:
        root_out[:] = moved
    for i in range(1, n):
        for r in range(3):
            arm[r] = positions[i, r] - positions[i - 1, r]
        cross(moved[:3], arm, work)
        for r in range(3):
            moved[3 + r] += work[r]
        j = (i - 1 - rigid_links) * hinges
        if j >= 0:
            for h in range(hinges):
                for row in range(6):
                    u[i, h] -= us[i, h, row] * moved[row]
            x, y = _solved(d[i], u[i])
            hinges_out[j] = x
            if hinges == 2:
                hinges_out[j + 1] = y
        for row in range(6):
            moved[row] += c[i, row]
            if j >= 0:
                for h in range(hinges):
                    moved[row] += s[i, h, row] * hinges_out[j + h]
        if i == root:
            root_out[:] = moved
