"""Forward dynamics of a chain by the articulated-body algorithm, compiled: linear in its modules.

Featherstone, Rigid Body Dynamics Algorithms, 2008, section 7.3, with its symbols. Spatial vectors
are in the world frame, angular part first, each module's taken at its centre. The force that the
joint before module i transmits is IA_i a_i + pA_i: a_i is the module's spatial acceleration, IA_i
the (6, 6) articulated-body inertia of all modules from i on, and pA_i their bias force. The joint
has the motion subspace S_i, and

    U = IA S,   D = Sᵀ U,   u = τ − Sᵀ (pA + IA c)
    Ia = IA − U D⁻¹ Uᵀ,   pa = pA + IA c + U D⁻¹ u

are what module i − 1 feels of it, c being the module's acceleration due to velocities alone.

S, U, D and IA of module 0 define how the chain responds to any force, for which
``planner.kernels.contact_forces`` uses them.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL, ONE, ZERO
from foldback.planner.kernels.kinematics import (
    Vector,
    copy_matrix,
    copy_vector,
    cross,
    matrix,
    product,
    rodrigues,
    rotate,
    vector,
)
from foldback.planner.kernels.module import ChainModel, Joint, Lumps, ModuleStates
from foldback.planner.kernels.velocities import write_lump

Array = NDArray[np.float64]


class Loads(NamedTuple):
    """Forces on a chain, and the rotor inertias of its hinges.

    Attributes:
        torques: (J,) τ of the hinges, in module mass · pitch² / s².
        rotor_inertias: (J,) rotor inertias of the hinges, in module mass · pitch².
        forces: (n, 3) forces at the modules' centres, in the world frame.
        end_torque: (3,) torque on the last module, in the world frame.
    """

    torques: Array
    rotor_inertias: Array
    forces: Array
    end_torque: Array


class ArticulatedBodies(NamedTuple):
    """Articulated-body quantities of the joint before each of n modules, of K hinges.

    Attributes:
        S: (n, K, 6) motion subspace: spatial accelerations of the module per q̈.
        U: (n, K, 6) IA S.
        D: (n, K, K) Sᵀ U, with the rotor inertias.
        root_inertia: (6, 6) IA of module 0.
        root_acceleration: (6,) spatial acceleration of module 0 without contacts.
    """

    S: Array
    U: Array
    D: Array
    root_inertia: Array
    root_acceleration: Array

    @classmethod
    def zeros(cls, modules: int, hinges: int) -> ArticulatedBodies:
        """Return arrays of zeros for a number of modules with K hinges a joint."""
        return cls(
            np.zeros((modules, hinges, 6)),
            np.zeros((modules, hinges, 6)),
            np.zeros((modules, hinges, hinges)),
            np.zeros((6, 6)),
            np.zeros(6),
        )


class Accelerations(NamedTuple):
    """Accelerations of a chain.

    Attributes:
        qdd: (J,) hinge accelerations q̈, in rad/s².
        root: (6,) spatial acceleration of the root at its centre, in the world frame.
    """

    qdd: Array
    root: Array


@njit(**KERNEL, nogil=True)
def unconstrained_accelerations(
    model: ChainModel,
    q: Array,
    qd: Array,
    loads: Loads,
    modules: ModuleStates,
    aba: ArticulatedBodies,
    out: Accelerations,
) -> None:
    """Write the accelerations of a chain without contacts.

    Args:
        model: Inertial parameters of the chain.
        q, qd: (J,) hinge angles and rates.
        loads: Forces, and rotor inertias.
        modules: Poses and velocities of all modules.
        aba: Written.
        out: Written; ``qdd`` is NaN where the numbers are not finite.
    """
    joint = model.joint
    positions = modules.positions
    n, hinges = positions.shape[0], aba.S.shape[1]
    IA_i, IA_parent = np.empty((6, 6)), np.empty((6, 6))
    pA_i, pA_parent = np.empty(6), np.empty(6)
    c = np.zeros((n, 6))
    u = np.zeros((n, hinges))
    _write_isolated_body(n - 1, model, modules, loads.forces, IA_i, pA_i)
    for r in range(3):
        pA_i[r] -= loads.end_torque[r]
    _add_lump(ONE, n - 1, model.lumps, modules, IA_i, pA_i)
    for i in range(n - 1, 0, -1):
        j = (i - 1 - joint.rigid_links) * hinges
        start, stop = max(j, 0), max(j + hinges, 0)  # no hinges in a rigid link
        _write_joint_motion(i, q[start:stop], qd[start:stop], joint, modules, aba.S[i], c[i])
        for row in range(6):
            for k in range(6):
                pA_i[row] += IA_i[row, k] * c[i, k]
        if j >= 0:
            for h in range(hinges):
                u[i, h] = loads.torques[j + h]
                for g in range(hinges):
                    aba.D[i, h, g] = loads.rotor_inertias[j + h] if h == g else 0.0
            _release_joint(aba.S[i], aba.U[i], aba.D[i], u[i], IA_i, pA_i)
        _write_isolated_body(i - 1, model, modules, loads.forces, IA_parent, pA_parent)
        _add_to_parent(IA_i, pA_i, link_vector(positions, i), IA_parent, pA_parent)
        IA_i, IA_parent = IA_parent, IA_i
        pA_i, pA_parent = pA_parent, pA_i
    _add_lump(ZERO, ZERO, model.lumps, modules, IA_i, pA_i)
    if _write_root_acceleration(IA_i, pA_i, model.fixed_base, aba):
        _propagate_accelerations(model, positions, aba, c, u, out)
    else:
        out.qdd[:] = np.nan


@njit(**INNER)
def _write_isolated_body(
    i: int, model: ChainModel, modules: ModuleStates, forces: Array, IA: Array, pA: Array
) -> None:
    """Write I = diag(R I_c Rᵀ, m) and p = (ω × R I_c Rᵀ ω, −f) of a module by itself.

    Args:
        i: Index of the module.
        model: Inertial parameters of the chain.
        modules: Poses and velocities of all modules.
        forces: (n, 3) forces f at the centres, in the world frame.
        IA, pA: (6, 6) and (6,) written.
    """
    rotation, omega, mass = modules.rotations[i], modules.angular_velocities[i], model.masses[i]
    IA[:] = 0.0
    for r in range(3):
        for c in range(3):
            for k in range(3):
                IA[r, c] += rotation[r, k] * (mass * model.inertia[k]) * rotation[c, k]
        IA[3 + r, 3 + r] = mass
    momentum = (
        IA[0, 0] * omega[0] + IA[0, 1] * omega[1] + IA[0, 2] * omega[2],
        IA[1, 0] * omega[0] + IA[1, 1] * omega[1] + IA[1, 2] * omega[2],
        IA[2, 0] * omega[0] + IA[2, 1] * omega[1] + IA[2, 2] * omega[2],
    )
    gyroscopic = cross(vector(omega), momentum)
    for r in range(3):
        pA[r] = gyroscopic[r]
        pA[3 + r] = -forces[i, r]


@njit(**INNER)
def _add_lump(end: int, i: int, lumps: Lumps, modules: ModuleStates, IA: Array, pA: Array) -> None:
    """Add to I and p of a module those of the lump fixed to it.

    With its mass m, centre of mass at c and inertia I_c about that, the lump adds to I the matrix
    ((I_c − m [c]× [c]×, m [c]×), (−m [c]×, m)) (Featherstone, 2008, chapter 2).

    Args:
        end: 0 for the lump of the first module, 1 for that of the last one.
        i: Index of that module.
        lumps: The lumps.
        modules: Poses and velocities of all modules.
        IA, pA: (6, 6) and (6,) changed.
    """
    mass = lumps.masses[end]
    if mass == 0.0:
        return
    omega = modules.angular_velocities[i]
    arm, lump_moments = np.empty(3), np.empty((3, 3))
    write_lump(end, i, lumps, modules, arm, lump_moments)
    square = arm[0] ** 2 + arm[1] ** 2 + arm[2] ** 2
    inward = _centripetal(vector(omega), vector(arm))
    gyroscopic = cross(vector(omega), vector(lump_moments @ omega))
    moment = cross(vector(arm), inward)
    for r in range(3):
        pA[r] += gyroscopic[r]
        pA[r] += mass * moment[r]
        pA[3 + r] += mass * inward[r]
        IA[3 + r, 3 + r] += mass
        IA[r, r] += mass * square
        for c in range(3):
            IA[r, c] += lump_moments[r, c] - mass * arm[r] * arm[c]
    x, y, z = mass * arm[0], mass * arm[1], mass * arm[2]
    IA[0, 4] -= z
    IA[0, 5] += y
    IA[1, 3] += z
    IA[1, 5] -= x
    IA[2, 3] -= y
    IA[2, 4] += x
    IA[4, 0] -= z
    IA[5, 0] += y
    IA[3, 1] += z
    IA[5, 1] -= x
    IA[3, 2] -= y
    IA[4, 2] += x


@njit(**INNER)
def _centripetal(omega: Vector, arm: Vector) -> Vector:
    """Return ω × (ω × arm)."""
    along = omega[0] * arm[0] + omega[1] * arm[1] + omega[2] * arm[2]
    square = omega[0] * omega[0] + omega[1] * omega[1] + omega[2] * omega[2]
    return (
        omega[0] * along - arm[0] * square,
        omega[1] * along - arm[1] * square,
        omega[2] * along - arm[2] * square,
    )


@njit(**INNER)
def link_vector(positions: Array, i: int) -> Vector:
    """Return the vector from the centre of module i − 1 to that of module i."""
    return (
        positions[i, 0] - positions[i - 1, 0],
        positions[i, 1] - positions[i - 1, 1],
        positions[i, 2] - positions[i - 1, 2],
    )


@njit(**INNER)
def _write_joint_motion(
    i: int,
    q: Array,
    qd: Array,
    joint: Joint,
    modules: ModuleStates,
    S: Array,
    c: Array,
) -> None:
    """Write S of the joint before module i, and c: what ω and q̇ add to the module's acceleration.

    On each side of the joint it is ω × (ω × arm), across a hinge with the axis s it is ω × s q̇. The
    axes are found from the outermost one on, in the frame that the hinges before it have turned.

    Args:
        i: Index of the module behind the joint.
        q, qd: (K,) angles and rates of the joint's hinges; (0,) for a rigid link.
        joint: The module's joint.
        modules: Poses and velocities of all modules.
        S: (K, 6) written.
        c: (6,) written; its angular part must be 0.
    """
    frame = matrix(modules.rotations[i - 1])
    omega = vector(modules.angular_velocities[i - 1])
    before = rotate(frame, joint.anchor)
    link = link_vector(modules.positions, i)
    arm = (link[0] - before[0], link[1] - before[1], link[2] - before[2])
    inward_before = _centripetal(omega, before)
    inward_behind = _centripetal(vector(modules.angular_velocities[i]), arm)
    hinges = q.shape[0]
    for h in range(hinges):
        axis = rotate(frame, joint.axes[h])
        convective = cross(omega, axis)
        moment = cross(axis, arm)
        for r in range(3):
            c[r] += convective[r] * qd[h]
            S[h, r] = axis[r]
            S[h, 3 + r] = moment[r]
        omega = (
            omega[0] + axis[0] * qd[h],
            omega[1] + axis[1] * qd[h],
            omega[2] + axis[2] * qd[h],
        )
        if h + 1 < hinges:
            frame = product(frame, rodrigues(joint.axes[h], q[h]))
    tangential = cross((c[0], c[1], c[2]), arm)
    for r in range(3):
        c[3 + r] = inward_before[r] + inward_behind[r] + tangential[r]


@njit(**INNER)
def solve_joint(D: Array, x: float, y: float) -> tuple[float, float]:
    """Return D⁻¹ (x, y) for a joint of two hinges; (x / D, 0) for one hinge."""
    if D.shape[0] == 1:
        return x / D[0, 0], 0.0
    determinant = D[0, 0] * D[1, 1] - D[0, 1] * D[1, 0]
    return (
        (D[1, 1] * x - D[0, 1] * y) / determinant,
        (D[0, 0] * y - D[1, 0] * x) / determinant,
    )


@njit(**INNER)
def _release_joint(S: Array, U: Array, D: Array, u: Array, IA: Array, pA: Array) -> None:
    """Write U, D and u of a joint, and turn IA and pA into Ia and pa, which its parent feels.

    Args:
        S: (K, 6) motion subspace.
        U: (K, 6) written.
        D: (K, K) holds the rotor inertias; Sᵀ U is added.
        u: (K,) holds τ; Sᵀ (pA + IA c) is subtracted.
        IA: (6, 6) articulated-body inertia, changed.
        pA: (6,) bias force with IA c in it, changed.
    """
    hinges = S.shape[0]
    last = hinges - 1
    for h in range(hinges):
        for row in range(6):
            U[h, row] = 0.0
            u[h] -= S[h, row] * pA[row]
            for k in range(6):
                U[h, row] += IA[row, k] * S[h, k]
    for h in range(hinges):
        for g in range(hinges):
            for row in range(6):
                D[h, g] += S[h, row] * U[g, row]
    for k in range(6):
        x, y = solve_joint(D, U[0, k], U[last, k])
        for row in range(6):
            IA[row, k] -= U[0, row] * x
            if hinges == 2:
                IA[row, k] -= U[1, row] * y
    for row in range(6):
        for k in range(row):  # rounding would grow from module to module
            IA[row, k] = IA[k, row]
    x, y = solve_joint(D, u[0], float(u[last]))
    for row in range(6):
        pA[row] += U[0, row] * x
        if hinges == 2:
            pA[row] += U[1, row] * y


@njit(**INNER)
def _add_to_parent(Ia: Array, pa: Array, r: Vector, IA_parent: Array, pA_parent: Array) -> None:
    """Add Xᵀ Ia X and Xᵀ pa, X (α, a) = (α, a + α × r), to a parent whose centre is at −r.

    Args:
        Ia: (6, 6) at the module's centre; overwritten.
        pa: (6,) at the module's centre.
        r: Vector from the parent's centre to the module's.
        IA_parent, pA_parent: (6, 6) and (6,) changed.
    """
    for row in range(6):
        shift = cross(r, (Ia[row, 3], Ia[row, 4], Ia[row, 5]))
        for k in range(3):
            Ia[row, k] += shift[k]
    for column in range(6):
        shift = cross(r, (Ia[3, column], Ia[4, column], Ia[5, column]))
        for k in range(3):
            Ia[k, column] += shift[k]
    for row in range(6):
        for column in range(6):
            IA_parent[row, column] += Ia[row, column]
    x, y, z = pa[3], pa[4], pa[5]
    pA_parent[0] += pa[0] + r[1] * z - r[2] * y
    pA_parent[1] += pa[1] + r[2] * x - r[0] * z
    pA_parent[2] += pa[2] + r[0] * y - r[1] * x
    for k in range(3, 6):
        pA_parent[k] += pa[k]


@njit(**INNER)
def _write_root_acceleration(
    IA: Array, pA: Array, fixed_base: bool, aba: ArticulatedBodies
) -> bool:
    """Write inertia and acceleration of module 0: a = −IA⁻¹ pA, or 0 if it is held.

    Returns:
        False if the numbers are not finite, and nothing is written.
    """
    a = np.zeros(6)
    is_finite = True
    for row in range(6):
        a[row] = -pA[row]
        is_finite = is_finite and np.isfinite(pA[row])
        for k in range(6):
            is_finite = is_finite and np.isfinite(IA[row, k])
    if not is_finite:
        return False
    if fixed_base:
        for row in range(6):
            a[row] = 0.0
            for k in range(6):
                # Larger values lose digits; with smaller ones the base gives under load.
                IA[row, k] = 1e15 if row == k else 0.0
    else:
        solved: Array = np.linalg.solve(IA, a)  # pyright: ignore[reportAssignmentType]
        copy_vector(solved, a)
    copy_matrix(IA, aba.root_inertia)
    copy_vector(a, aba.root_acceleration)
    return True


@njit(**INNER)
def shift_acceleration(a: Array, arm: Vector) -> None:
    """Move the point that a (6,) spatial acceleration is taken at: a ← (α, a + α × arm)."""
    tangential = cross((a[0], a[1], a[2]), arm)
    for r in range(3):
        a[3 + r] += tangential[r]


@njit(**INNER)
def _propagate_accelerations(
    model: ChainModel,
    positions: Array,
    aba: ArticulatedBodies,
    c: Array,
    u: Array,
    out: Accelerations,
) -> None:
    """Write q̈ = D⁻¹ (u − Uᵀ a_parent) outwards, with a = a_parent + c + S q̈.

    Args:
        model: Inertial parameters of the chain.
        positions: (n, 3) centres of the modules.
        aba: S, U, D, and the acceleration of module 0.
        c: (n, 6) accelerations due to velocities.
        u: (n, K) see the module's docstring; changed.
        out: Written.
    """
    S, U, D = aba.S, aba.U, aba.D
    hinges = S.shape[1]
    a = aba.root_acceleration.copy()
    if model.root == 0:
        copy_vector(a, out.root)
    for i in range(1, positions.shape[0]):
        shift_acceleration(a, link_vector(positions, i))
        j = (i - 1 - model.joint.rigid_links) * hinges
        if j >= 0:
            for h in range(hinges):
                for row in range(6):
                    u[i, h] -= U[i, h, row] * a[row]
            x, y = solve_joint(D[i], u[i, 0], u[i, hinges - 1])
            out.qdd[j] = x
            if hinges == 2:
                out.qdd[j + 1] = y
        for row in range(6):
            a[row] += c[i, row]
            if j >= 0:
                for h in range(hinges):
                    a[row] += S[i, h, row] * out.qdd[j + h]
        if i == model.root:
            copy_vector(a, out.root)
