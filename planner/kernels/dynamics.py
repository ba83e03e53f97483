"""Inverse dynamics of a free chain by Newton and Euler, compiled: linear in its modules.

Accelerations are propagated outwards from module 0, forces inwards from the last module (recursive
Newton–Euler algorithm; Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 5).
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL
from foldback.planner.kernels.kinematics import (
    Matrix,
    Vector,
    cross,
    matrix,
    product,
    rodrigues,
    rotate,
    vector,
)
from foldback.planner.kernels.module import Joint, Lumps

Array = NDArray[np.float64]
Symmetric: TypeAlias = tuple[float, float, float, float, float, float]
"""Elements xx, yy, zz, xy, xz and yz of a symmetric (3, 3) matrix."""


class _Recursion(NamedTuple):
    """Quantities of one configuration of n modules, in the frame of module 0.

    The b = n + 2 bodies are the modules and the lumps of the first and of the last one.

    Attributes:
        masses: (b,) masses.
        positions: (b, 3) centres of mass.
        pivots: (n, 3) centres of the joints to the next modules.
        axes: (n, K, 3) axes of those joints.
        inertias: (b, 6) inertia about the centre of mass, as ``Symmetric``.
        velocities: (b, 3) v of the centres of mass.
        omega: (b, 3) angular velocities ω.
        accelerations: (b, 3) a of the centres of mass.
        alpha: (b, 3) angular accelerations α.
        arms: (b, 3) centres of mass relative to that of the chain.
        moments: (b, 3) torques about the centres of mass.
    """

    masses: Array

    positions: Array
    pivots: Array
    axes: Array
    inertias: Array
    velocities: Array
    omega: Array
    accelerations: Array
    alpha: Array
    arms: Array
    moments: Array


@njit(**INNER)
def _module_inertia(rotation: Matrix, inertia: Array) -> Symmetric:
    """Return R diag(inertia) Rᵀ."""
    x, y, z = inertia[0], inertia[1], inertia[2]
    a, b, c, d, e, f, g, h, i = rotation
    return (
        a * a * x + b * b * y + c * c * z,
        d * d * x + e * e * y + f * f * z,
        g * g * x + h * h * y + i * i * z,
        a * d * x + b * e * y + c * f * z,
        a * g * x + b * h * y + c * i * z,
        d * g * x + e * h * y + f * i * z,
    )


@njit(**INNER)
def _apply_symmetric(m: Array, v: Vector) -> Vector:
    """Return M v for the elements of a symmetric M."""
    return (
        m[0] * v[0] + m[3] * v[1] + m[4] * v[2],
        m[3] * v[0] + m[1] * v[1] + m[5] * v[2],
        m[4] * v[0] + m[5] * v[1] + m[2] * v[2],
    )


@njit(**INNER)
def _solve_symmetric(m: Array, v: Vector) -> Vector:
    """Return M⁻¹ v for the elements of a symmetric M by its adjugate; NaN if M is singular."""
    a = m[1] * m[2] - m[5] * m[5]
    b = m[4] * m[5] - m[3] * m[2]
    c = m[3] * m[5] - m[4] * m[1]
    determinant = m[0] * a + m[3] * b + m[4] * c
    inverse = 1.0 / determinant if determinant != 0.0 else np.nan
    d = m[0] * m[2] - m[4] * m[4]
    e = m[3] * m[4] - m[0] * m[5]
    f = m[0] * m[1] - m[3] * m[3]
    return (
        inverse * (a * v[0] + b * v[1] + c * v[2]),
        inverse * (b * v[0] + d * v[1] + e * v[2]),
        inverse * (c * v[0] + e * v[1] + f * v[2]),
    )


@njit(**INNER)
def _propagate_velocities(
    q: Array, qd: Array, joint: Joint, inertia: Array, lumps: Lumps, out: _Recursion
) -> None:
    """Write poses, axes, inertias, v and ω outwards, module 0 upright and at rest at the origin.

    Args:
        q, qd: (J,) hinge angles and rates.
        joint: The module's joint.
        inertia: (3,) principal moments of a module of mass 1 about its centre.
        lumps: Rigid bodies at both ends.
        out: Written up to ``omega``.
    """
    n, hinges = out.pivots.shape[0], joint.axes.shape[0]
    fixed = matrix(joint.turn)
    rotation = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    x, y, z = 0.0, 0.0, 0.0
    u, v, w = 0.0, 0.0, 0.0
    omega = (0.0, 0.0, 0.0)
    for i in range(n):
        out.positions[i, 0], out.positions[i, 1], out.positions[i, 2] = x, y, z
        out.velocities[i, 0], out.velocities[i, 1], out.velocities[i, 2] = u, v, w
        out.omega[i, 0], out.omega[i, 1], out.omega[i, 2] = omega
        module_inertia = _module_inertia(rotation, inertia)
        for k in range(6):
            out.inertias[i, k] = module_inertia[k]
        if i == 0:
            _write_lump(0, i, rotation, lumps, out)
        if i + 1 == n:
            _write_lump(1, i, rotation, lumps, out)
            return
        arm = rotate(rotation, joint.anchor)
        turning = cross(omega, arm)
        u, v, w = u + turning[0], v + turning[1], w + turning[2]
        x, y, z = x + arm[0], y + arm[1], z + arm[2]
        out.pivots[i, 0], out.pivots[i, 1], out.pivots[i, 2] = x, y, z
        j = (i - joint.rigid_links) * hinges
        if j >= 0:
            for k in range(hinges):
                axis = rotate(rotation, joint.axes[k])
                out.axes[i, k, 0], out.axes[i, k, 1], out.axes[i, k, 2] = axis
                omega = _add_scaled(omega, axis, float(qd[j + k]))
                rotation = product(rotation, rodrigues(joint.axes[k], float(q[j + k])))
        rotation = product(rotation, fixed)
        arm = rotate(rotation, joint.offset)
        turning = cross(omega, arm)
        u, v, w = u + turning[0], v + turning[1], w + turning[2]
        x, y, z = x + arm[0], y + arm[1], z + arm[2]


@njit(**INNER)
def _write_lump(end: int, i: int, rotation: Matrix, lumps: Lumps, out: _Recursion) -> None:
    """Write mass, position, inertia, v and ω of a lump.

    Args:
        end: 0 for the lump of the first module, 1 for that of the last one.
        i: Index of that module.
        rotation: Orientation of that module.
        lumps: The lumps.
        out: Written.
    """
    b = out.pivots.shape[0] + end
    arm = rotate(rotation, lumps.centres[end])
    turning = cross(vector(out.omega[i]), arm)
    lump_inertia = _module_inertia(product(rotation, matrix(lumps.axes[end])), lumps.moments[end])
    out.masses[b] = lumps.masses[end]
    for r in range(3):
        out.positions[b, r] = out.positions[i, r] + arm[r]
        out.velocities[b, r] = out.velocities[i, r] + turning[r]
        out.omega[b, r] = out.omega[i, r]
    for k in range(6):
        out.inertias[b, k] = lump_inertia[k]


@njit(**INNER)
def _add_scaled(a: Vector, b: Vector, factor: float) -> Vector:
    """Return a + factor b."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@njit(**INNER)
def _scaled(factor: float, a: Vector) -> Vector:
    """Return factor a."""
    return factor * a[0], factor * a[1], factor * a[2]


@njit(**INNER)
def _difference(a: Array, b: Array) -> Vector:
    """Return a − b of two (3,) arrays."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(**INNER)
def _propagate_accelerations(qd: Array, qdd: Array, rigid_links: int, out: _Recursion) -> None:
    """Write a and α outwards, those of module 0 being zero.

    Across a hinge α' = α + s q̈ + ω × s q̇, with its axis s.

    Args:
        qd, qdd: (J,) hinge rates and accelerations.
        rigid_links: Number of links without hinges at the start of the chain.
        out: As ``_propagate_velocities`` writes it; ``accelerations`` and ``alpha`` are written.
    """
    n, hinges = out.pivots.shape[0], out.axes.shape[1]
    alpha = (0.0, 0.0, 0.0)
    a = (0.0, 0.0, 0.0)
    for i in range(n):
        out.accelerations[i, 0], out.accelerations[i, 1], out.accelerations[i, 2] = a
        out.alpha[i, 0], out.alpha[i, 1], out.alpha[i, 2] = alpha
        for end in range(2):
            if i == end * (n - 1):
                b = n + end
                arm = _difference(out.positions[b], out.positions[i])
                shifted = _shift_acceleration(a, alpha, vector(out.omega[i]), arm)
                out.accelerations[b, 0], out.accelerations[b, 1] = shifted[0], shifted[1]
                out.accelerations[b, 2] = shifted[2]
                out.alpha[b, 0], out.alpha[b, 1], out.alpha[b, 2] = alpha
        if i + 1 == n:
            return
        omega = vector(out.omega[i])
        a = _shift_acceleration(a, alpha, omega, _difference(out.pivots[i], out.positions[i]))
        j = (i - rigid_links) * hinges
        if j >= 0:
            for k in range(hinges):
                axis = vector(out.axes[i, k])
                alpha = _add_scaled(alpha, axis, float(qdd[j + k]))
                alpha = _add_scaled(alpha, cross(omega, axis), float(qd[j + k]))
                omega = _add_scaled(omega, axis, float(qd[j + k]))
        a = _shift_acceleration(a, alpha, omega, _difference(out.positions[i + 1], out.pivots[i]))


@njit(**INNER)
def _shift_acceleration(a: Vector, alpha: Vector, omega: Vector, arm: Vector) -> Vector:
    """Return the acceleration of a body's point at ``arm``: a + α × arm + ω × (ω × arm)."""
    tangential = cross(alpha, arm)
    centripetal = cross(omega, cross(omega, arm))
    return (
        a[0] + tangential[0] + centripetal[0],
        a[1] + tangential[1] + centripetal[1],
        a[2] + tangential[2] + centripetal[2],
    )


@njit(**INNER)
def _cancel_momentum(
    chain: _Recursion, linear: Array, angular: Array, moments: Array, composite: Array
) -> None:
    """Add the motion of one rigid body to all bodies, so that the chain has no momentum.

    Given accelerations and torques instead of velocities and angular momenta, so that its momentum
    does not change.

    Args:
        chain: Masses, and arms.
        linear, angular: (b, 3) velocities or accelerations; changed.
        moments: (b, 3) angular momenta or torques about the centres of mass.
        composite: (6,) inertia of the whole chain about its centre of mass, as ``Symmetric``.
    """
    arms, masses = chain.arms, chain.masses
    n = masses.shape[0]
    total = masses.sum()
    a, b, c = 0.0, 0.0, 0.0
    x, y, z = 0.0, 0.0, 0.0
    for i in range(n):
        module_momentum = _scaled(masses[i], vector(linear[i]))
        orbital = cross(vector(arms[i]), module_momentum)
        a, b, c = a + module_momentum[0], b + module_momentum[1], c + module_momentum[2]
        x, y, z = (
            x + orbital[0] + moments[i, 0],
            y + orbital[1] + moments[i, 1],
            z + orbital[2] + moments[i, 2],
        )
    rigid = _solve_symmetric(composite, (-x, -y, -z))
    for i in range(n):
        orbital = cross(rigid, vector(arms[i]))
        linear[i, 0] += orbital[0] - a / total
        linear[i, 1] += orbital[1] - b / total
        linear[i, 2] += orbital[2] - c / total
        angular[i, 0] += rigid[0]
        angular[i, 1] += rigid[1]
        angular[i, 2] += rigid[2]


@njit(**INNER)
def _euler_torques(inertias: Array, omega: Array, alpha: Array, out: Array) -> None:
    """Write (b, 3) torques of rotation about the centres of mass: I α + ω × I ω."""
    for i in range(out.shape[0]):
        spin = vector(omega[i])
        inertial = _apply_symmetric(inertias[i], vector(alpha[i]))
        gyroscopic = cross(spin, _apply_symmetric(inertias[i], spin))
        out[i, 0] = inertial[0] + gyroscopic[0]
        out[i, 1] = inertial[1] + gyroscopic[1]
        out[i, 2] = inertial[2] + gyroscopic[2]


@njit(**INNER)
def _write_composite_inertia(chain: _Recursion, composite: Array) -> None:
    """Write the arms, and the (6,) inertia of the whole chain about its centre of mass."""
    masses, positions = chain.masses, chain.positions
    inertias, arms = chain.inertias, chain.arms
    n = masses.shape[0]
    total = masses.sum()
    for r in range(3):
        centre = 0.0
        for i in range(n):
            centre += masses[i] * positions[i, r]
        for i in range(n):
            arms[i, r] = positions[i, r] - centre / total
    for k in range(6):
        composite[k] = 0.0
    for i in range(n):
        m = masses[i]
        x, y, z = arms[i, 0], arms[i, 1], arms[i, 2]
        composite[0] += m * (y * y + z * z) + inertias[i, 0]
        composite[1] += m * (x * x + z * z) + inertias[i, 1]
        composite[2] += m * (x * x + y * y) + inertias[i, 2]
        composite[3] += inertias[i, 3] - m * x * y
        composite[4] += inertias[i, 4] - m * x * z
        composite[5] += inertias[i, 5] - m * y * z


@njit(**INNER)
def _write_hinge_torques(chain: _Recursion, rigid_links: int, out: Array) -> None:
    """Write (J,) hinge torques: the moment about each axis that all modules beyond it need.

    Force and moment about the origin are summed inwards from the last module.
    """
    n, hinges = chain.pivots.shape[0], chain.axes.shape[1]
    lump = n + 1
    force = _scaled(float(chain.masses[lump]), vector(chain.accelerations[lump]))
    orbital = cross(vector(chain.positions[lump]), force)
    moment = _add_scaled(orbital, vector(chain.moments[lump]), 1.0)
    for i in range(n - 1, rigid_links, -1):
        module_force = vector(chain.accelerations[i])
        orbital = cross(vector(chain.positions[i]), module_force)
        force = (force[0] + module_force[0], force[1] + module_force[1], force[2] + module_force[2])
        moment = (
            moment[0] + orbital[0] + chain.moments[i, 0],
            moment[1] + orbital[1] + chain.moments[i, 1],
            moment[2] + orbital[2] + chain.moments[i, 2],
        )
        shift = cross(vector(chain.pivots[i - 1]), force)
        j = (i - 1 - rigid_links) * hinges
        for k in range(hinges):
            axis = vector(chain.axes[i - 1, k])
            out[j + k] = (
                axis[0] * (moment[0] - shift[0])
                + axis[1] * (moment[1] - shift[1])
                + axis[2] * (moment[2] - shift[2])
            )


@njit(**KERNEL, nogil=True)
def many_floating_torques(
    q: Array, qd: Array, qdd: Array, joint: Joint, inertia: Array, lumps: Lumps, out: Array
) -> None:
    """Write the (F, J) hinge torques of motions of a free chain that has no momentum.

    Args:
        q, qd, qdd: (F, J) hinge angles, rates and accelerations.
        joint: The module's joint.
        inertia: (3,) principal moments of a module of mass 1 about its centre.
        lumps: Rigid bodies at both ends.
        out: (F, J) written, in module mass · pitch² / s²; NaN where the motion is not finite.
    """
    rigid_links, hinges = joint.rigid_links, joint.axes.shape[0]
    frames, joints = q.shape
    n = joints // hinges + 1 + rigid_links
    bodies = n + 2
    chain = _Recursion(
        np.ones(bodies),
        np.empty((bodies, 3)),
        np.empty((n, 3)),
        np.zeros((n, hinges, 3)),
        np.empty((bodies, 6)),
        np.empty((bodies, 3)),
        np.empty((bodies, 3)),
        np.empty((bodies, 3)),
        np.empty((bodies, 3)),
        np.empty((bodies, 3)),
        np.empty((bodies, 3)),
    )
    inertias, moments, omega = chain.inertias, chain.moments, chain.omega
    composite, at_rest = np.empty(6), np.zeros((bodies, 3))
    for f in range(frames):
        _propagate_velocities(q[f], qd[f], joint, inertia, lumps, chain)
        _write_composite_inertia(chain, composite)
        # I α + ω × I ω with ω = 0 and ω in place of α is the angular momentum.
        _euler_torques(inertias, at_rest, omega, moments)
        _cancel_momentum(chain, chain.velocities, omega, moments, composite)
        _propagate_accelerations(qd[f], qdd[f], rigid_links, chain)
        _euler_torques(inertias, omega, chain.alpha, moments)
        _cancel_momentum(chain, chain.accelerations, chain.alpha, moments, composite)
        _euler_torques(inertias, omega, chain.alpha, moments)
        _write_hinge_torques(chain, rigid_links, out[f])
