"""Forces of soft contacts without friction on a chain, compiled.

The model is MuJoCo's (its documentation, "Computation", "Constraint model"). With J the rows of the
contact normals and M the chain's mass matrix, the forces f solve the linear complementarity problem

    f ≥ 0,   A f + R f + b ≥ 0,   fᵀ (A f + R f + b) = 0,

A = J M⁻¹ Jᵀ being the Delassus operator, R a diagonal regularisation, and b = J a − a_ref the
accelerations at which the contacts part without forces, minus those that they should have.
Products with M⁻¹ follow from the articulated-body quantities of ``planner.kernels.articulated``.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL, ZERO
from foldback.planner.kernels.articulated import (
    Accelerations,
    ArticulatedBodies,
    link_vector,
    shift_acceleration,
    solve_joint,
)
from foldback.planner.kernels.kinematics import copy_vector, cross, vector
from foldback.planner.kernels.module import ChainModel, ModuleStates

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
MAX_DIRECT_CONTACTS = 500
"""Maximum number of contact points of a simulation step whose forces are solved exactly, at a cost
that grows with the square of their number; with more, forces are approximate, off by some per cent.
Decision 0015."""
MAX_PIVOTS = 100
"""Maximum number of pivots with which the linear complementarity problem of the contact forces is
solved exactly; beyond it the slower, approximate gradient solver takes over."""
MAX_NON_IMPROVING_PIVOTS = 3
"""Number of block pivots in a row that do not reduce the number of infeasible contact forces before
the solver changes to single pivots, which cannot cycle: p̄ in Júdice & Pires (1994)."""


class PairContacts(NamedTuple):
    """Contact points between modules.

    Attributes:
        pairs: (m, 2) modules; the normal points to the second one.
        normals: (m, 3) unit normals in the world frame.
        points: (m, 3) points in the world frame, in pitches.
        depths: (m,) depths of penetration, in pitches.
    """

    pairs: Ints
    normals: Array
    points: Array
    depths: Array


class ContactModel(NamedTuple):
    """Stiffness of all contacts, in MuJoCo's parameters.

    Attributes:
        time_constant: Time in s in which a penetration decays, ``solref[0]``.
        damping_ratio: 1 for critical damping, ``solref[1]``.
        solimp: (5,) impedance as a function of depth.
    """

    time_constant: float
    damping_ratio: float
    solimp: Array


class ContactOperator(NamedTuple):
    """Response of a chain at rest to wrenches on its modules, M⁻¹ without writing it down.

    Attributes:
        aba: Articulated-body quantities of the configuration.
        inverse_root_inertia: (6, 6) inverse of ``aba.root_inertia``.
        rigid_links: Number of links without hinges at the start of the chain.
        positions: (n, 3) centres of the modules.
        last: Index of the last module in a contact.
    """

    aba: ArticulatedBodies
    inverse_root_inertia: Array
    rigid_links: int
    positions: Array
    last: int


class FreeMotion(NamedTuple):
    """Motion of the modules in contacts, without the forces of these.

    Attributes:
        velocities: (n, 6) spatial velocities; only those of modules in contacts are defined.
        accelerations: (n, 6) spatial accelerations up to the last module in a contact. They lack
            the parts due to velocities, as those of MuJoCo's rows do.
    """

    velocities: Array
    accelerations: Array


@njit(**KERNEL, nogil=True)
def add_contacts(
    contacts: PairContacts,
    contact_model: ContactModel,
    model: ChainModel,
    modules: ModuleStates,
    aba: ArticulatedBodies,
    out: Accelerations,
) -> bool:
    """Add the effect of contacts to accelerations without contacts, by an exact solution.

    Args:
        contacts: m contacts.
        contact_model: Their stiffness.
        model: Inertial parameters of the chain.
        modules: Poses and velocities of all modules.
        aba: From ``unconstrained_accelerations``.
        out: From there; changed.

    Returns:
        False if no solution was found, and nothing is added.
    """
    operator = _contact_operator(contacts, model, modules.positions, aba)
    free = _free_motion(contacts, operator, modules, out.qdd)
    m = contacts.depths.shape[0]
    A = np.empty((m, m))
    b = np.empty(m)
    _write_delassus(contacts, operator, A)
    for k in range(m):
        impedance = _impedance(contacts.depths[k], contact_model.solimp)
        b[k] = _lcp_bias(k, contacts, contact_model, impedance, operator.positions, free)
        A[k, k] += _regularisation(A[k, k], impedance)
    forces = np.zeros(m)
    if not _solve_lcp_block_pivoting(A, b, forces):
        return False
    _add_response(forces, contacts, operator, model.root, out)
    return True


@njit(**KERNEL, nogil=True)
def add_many_contacts(
    contacts: PairContacts,
    contact_model: ContactModel,
    model: ChainModel,
    modules: ModuleStates,
    aba: ArticulatedBodies,
    out: Accelerations,
) -> None:
    """Add the effect of contacts approximately, without writing A down; see ``add_contacts``.

    R is taken from an approximate diagonal of A, that of two modules that are not connected.
    """
    operator = _contact_operator(contacts, model, modules.positions, aba)
    free = _free_motion(contacts, operator, modules, out.qdd)
    n, m = modules.positions.shape[0], contacts.depths.shape[0]
    inverse_inertias = np.empty((n, 6, 6))
    _write_inverse_operational_inertias(operator, inverse_inertias)
    wrenches = np.zeros((n, 6))
    diagonals = np.empty((2, m))
    b = np.empty(m)
    for k in range(m):
        i, j = contacts.pairs[k, 0], contacts.pairs[k, 1]
        _add_contact_force(k, contacts, operator.positions, 1.0, wrenches)
        diagonals[0, k] = (wrenches[i] * (inverse_inertias[i] @ wrenches[i])).sum()
        diagonals[0, k] += (wrenches[j] * (inverse_inertias[j] @ wrenches[j])).sum()
        wrenches[i] = 0.0
        wrenches[j] = 0.0
        impedance = _impedance(contacts.depths[k], contact_model.solimp)
        b[k] = _lcp_bias(k, contacts, contact_model, impedance, operator.positions, free)
        diagonals[1, k] = _regularisation(diagonals[0, k], impedance)
    forces = np.zeros(m)
    _solve_lcp_gradient(b, diagonals, contacts, operator, forces)
    _add_response(forces, contacts, operator, model.root, out)


@njit(**INNER)
def _contact_operator(
    contacts: PairContacts, model: ChainModel, positions: Array, aba: ArticulatedBodies
) -> ContactOperator:
    """Return the response of a chain whose articulated-body quantities are known."""
    inverse: Array = np.linalg.inv(aba.root_inertia)  # pyright: ignore[reportAssignmentType]
    last = ZERO
    for k in range(contacts.pairs.shape[0]):
        last = max(last, contacts.pairs[k, 0], contacts.pairs[k, 1])
    return ContactOperator(aba, inverse, model.joint.rigid_links, positions, last)


@njit(**INNER)
def _free_motion(
    contacts: PairContacts, operator: ContactOperator, modules: ModuleStates, qdd: Array
) -> FreeMotion:
    """Return the motion of the modules in contacts under (J,) accelerations of the hinges."""
    positions, S = operator.positions, operator.aba.S
    n, hinges = positions.shape[0], S.shape[1]
    velocities, accelerations = np.empty((n, 6)), np.zeros((n, 6))
    for k in range(contacts.pairs.shape[0]):
        for side in range(2):
            i = contacts.pairs[k, side]
            for r in range(3):
                velocities[i, r] = modules.angular_velocities[i, r]
                velocities[i, 3 + r] = modules.velocities[i, r]
    copy_vector(operator.aba.root_acceleration, accelerations[0])
    for i in range(1, operator.last + 1):
        a = accelerations[i]
        copy_vector(accelerations[i - 1], a)
        shift_acceleration(a, link_vector(positions, i))
        if i > operator.rigid_links:
            j = (i - 1 - operator.rigid_links) * hinges
            for h in range(hinges):
                for r in range(6):
                    a[r] += S[i, h, r] * qdd[j + h]
    return FreeMotion(velocities, accelerations)


@njit(**INNER)
def _impedance(depth: float, solimp: Array) -> float:
    """Return the impedance d of a contact: MuJoCo's documentation, "solimp".

    Args:
        depth: Depth of penetration, in pitches.
        solimp: (5,) smallest and largest impedance, width, midpoint and power.
    """
    smallest, largest, width, middle, power = solimp
    x = min(depth / width, 1.0)
    y = x**power / middle ** (power - 1.0)
    if x > middle:
        y = 1.0 - (1.0 - x) ** power / (1.0 - middle) ** (power - 1.0)
    return smallest + y * (largest - smallest)


@njit(**INNER)
def _regularisation(diagonal: float, impedance: float) -> float:
    """Return R = A (1 − d) / d of a contact, from its diagonal element of A."""
    return max(diagonal * (1.0 - impedance) / impedance, 1e-15)  # else singular


@njit(**INNER)
def _lcp_bias(
    k: int,
    contacts: PairContacts,
    contact_model: ContactModel,
    impedance: float,
    positions: Array,
    free: FreeMotion,
) -> float:
    """Return b = J a − a_ref of contact k, a_ref = −B J v + K depth; MuJoCo's "solref".

    With the time constant T, the damping ratio ζ and the largest impedance d_max, B is
    2 / (d_max T) and K is d / (d_max T ζ)².
    """
    constant, ratio, solimp = contact_model
    scaled = solimp[1] * constant
    target_acceleration = -2.0 / scaled * _normal_velocity(k, contacts, positions, free.velocities)
    target_acceleration += impedance * contacts.depths[k] / (scaled * ratio) ** 2
    return _normal_velocity(k, contacts, positions, free.accelerations) - target_acceleration


@njit(**INNER)
def _normal_velocity(k: int, contacts: PairContacts, positions: Array, motions: Array) -> float:
    """Return the row J_k of contact k times (n, 6) motions: the speed at which two modules part."""
    normal, point = contacts.normals[k], contacts.points[k]
    speed = 0.0
    for side in range(2):
        i, sign = contacts.pairs[k, side], 2.0 * side - 1.0
        arm = (
            point[0] - positions[i, 0],
            point[1] - positions[i, 1],
            point[2] - positions[i, 2],
        )
        turning = cross((motions[i, 0], motions[i, 1], motions[i, 2]), arm)
        for r in range(3):
            speed += sign * normal[r] * (motions[i, 3 + r] + turning[r])
    return speed


@njit(**INNER)
def _add_contact_force(
    k: int, contacts: PairContacts, positions: Array, force: float, wrenches: Array
) -> None:
    """Add J_kᵀ f to (n, 6) wrenches: a force f on both modules of contact k, along the normal."""
    normal, point = contacts.normals[k], contacts.points[k]
    for side in range(2):
        i, signed = contacts.pairs[k, side], force if side else -force
        arm = (
            point[0] - positions[i, 0],
            point[1] - positions[i, 1],
            point[2] - positions[i, 2],
        )
        moment = cross(arm, vector(normal))
        for r in range(3):
            wrenches[i, r] += signed * moment[r]
            wrenches[i, 3 + r] += signed * normal[r]


@njit(**INNER)
def _add_contact_forces(
    forces: Array, contacts: PairContacts, positions: Array, wrenches: Array
) -> None:
    """Add Jᵀ f to (n, 6) wrenches for (m,) forces in the contacts."""
    for k in range(forces.shape[0]):
        if forces[k] != 0.0:
            _add_contact_force(k, contacts, positions, forces[k], wrenches)


@njit(**INNER)
def _add_response(
    forces: Array, contacts: PairContacts, operator: ContactOperator, root: int, out: Accelerations
) -> None:
    """Add what (m,) forces in the contacts cause to the accelerations of hinges and root."""
    n = operator.positions.shape[0]
    wrenches = np.zeros((n, 6))
    response = np.zeros((n, 6))
    _add_contact_forces(forces, contacts, operator.positions, wrenches)
    _propagate_wrenches(wrenches, operator.last, n - 1, operator, response, out.qdd)
    for r in range(6):
        out.root[r] += response[root, r]


@njit(**INNER)
def _propagate_wrenches(
    wrenches: Array,
    last: int,
    top: int,
    operator: ContactOperator,
    accelerations: Array,
    qdd: Array,
) -> None:
    """Write the accelerations that wrenches alone cause: the second and third pass of the ABA.

    Args:
        wrenches: (n, 6) on the modules at their centres, torque first; none beyond ``last``.
        last: Last module with a wrench.
        top: Last module whose acceleration is computed.
        operator: Response of the chain.
        accelerations: (n, 6) written up to ``top``.
        qdd: (J,) to which the hinges' accelerations are added, up to ``top``.
    """
    S, U, D = operator.aba.S, operator.aba.U, operator.aba.D
    positions, rigid_links = operator.positions, operator.rigid_links
    hinges = S.shape[1]
    u = np.zeros((last + 1, hinges))
    p = np.zeros(6)
    for i in range(last, 0, -1):
        for k in range(6):
            p[k] -= wrenches[i, k]
        if i > rigid_links:
            for h in range(hinges):
                for k in range(6):
                    u[i, h] -= S[i, h, k] * p[k]
            x, y = solve_joint(D[i], u[i, 0], u[i, hinges - 1])
            for k in range(6):
                p[k] += U[i, 0, k] * x
                if hinges == 2:
                    p[k] += U[i, 1, k] * y
        moment = cross(link_vector(positions, i), (p[3], p[4], p[5]))
        for r in range(3):
            p[r] += moment[r]
    a = np.zeros(6)
    for k in range(6):
        for m in range(6):
            a[k] += operator.inverse_root_inertia[k, m] * (wrenches[0, m] - p[m])
    copy_vector(a, accelerations[0])
    for i in range(1, top + 1):
        shift_acceleration(a, link_vector(positions, i))
        if i > rigid_links:
            j = (i - 1 - rigid_links) * hinges
            x = u[i, 0] if i <= last else 0.0
            y = u[i, hinges - 1] if i <= last else 0.0
            for k in range(6):
                x -= U[i, 0, k] * a[k]
                y -= U[i, hinges - 1, k] * a[k]
            x, y = solve_joint(D[i], x, y)
            qdd[j] += x
            if hinges == 2:
                qdd[j + 1] += y
            for k in range(6):
                a[k] += S[i, 0, k] * x
                if hinges == 2:
                    a[k] += S[i, 1, k] * y
        copy_vector(a, accelerations[i])


@njit(**INNER)
def _write_delassus(contacts: PairContacts, operator: ContactOperator, A: Array) -> None:
    """Write the (m, m) Delassus matrix A = J M⁻¹ Jᵀ, column by column."""
    n, hinges = operator.aba.S.shape[0], operator.aba.S.shape[1]
    m = contacts.depths.shape[0]
    response, wrenches = np.zeros((n, 6)), np.zeros((n, 6))
    discarded = np.zeros(n * hinges)
    for k in range(m):
        i, j = contacts.pairs[k, 0], contacts.pairs[k, 1]
        _add_contact_force(k, contacts, operator.positions, 1.0, wrenches)
        _propagate_wrenches(wrenches, max(i, j), operator.last, operator, response, discarded)
        for g in range(m):
            A[g, k] = _normal_velocity(g, contacts, operator.positions, response)
        for r in range(6):
            wrenches[i, r] = 0.0
            wrenches[j, r] = 0.0


@njit(**INNER)
def _solve_lcp_block_pivoting(A: Array, b: Array, f: Array) -> bool:
    """Write the f ≥ 0 with A f + b ≥ 0 and fᵀ (A f + b) = 0, by block principal pivoting.

    It ends for every positive definite A (Júdice and Pires, Computers & Operations Research 21,
    1994): blocks of infeasible variables change sides while their number falls, then single ones.

    Args:
        A: (m, m) matrix, with R on its diagonal.
        b: (m,) bias.
        f: (m,) written.

    Returns:
        False if ``MAX_PIVOTS`` were not enough.
    """
    m = b.shape[0]
    is_basic = np.empty(m, np.bool_)
    is_infeasible = np.empty(m, np.bool_)
    basic = np.empty(m, np.int64)
    tolerance = 0.0
    for k in range(m):
        is_basic[k] = b[k] < 0.0
        tolerance = max(tolerance, 1e-10 * abs(b[k]))  # with less, rounding causes endless pivots
    fewest, remaining = m + 1, MAX_NON_IMPROVING_PIVOTS
    for _ in range(MAX_PIVOTS):
        size = ZERO
        for k in range(m):
            f[k] = 0.0
            if is_basic[k]:
                basic[size] = k
                size += 1
        block = np.empty((size, size))
        solution = np.empty(size)
        for r in range(size):
            solution[r] = -b[basic[r]]
            for c in range(size):
                block[r, c] = A[basic[r], basic[c]]
        if size:
            solution = np.linalg.solve(block, solution)
        for r in range(size):
            f[basic[r]] = solution[r]
        product = A @ f
        infeasible = ZERO
        last = ZERO
        for k in range(m):
            is_infeasible[k] = f[k] < 0.0 if is_basic[k] else b[k] + product[k] < -tolerance
            if is_infeasible[k]:
                infeasible += 1
                last = k
        if infeasible == 0:
            return True
        if infeasible < fewest:
            fewest, remaining = infeasible, MAX_NON_IMPROVING_PIVOTS
        else:
            remaining -= 1
        for k in range(m):
            if is_infeasible[k] and (remaining >= 0 or k == last):
                is_basic[k] = not is_basic[k]
    return False


@njit(**INNER)
def _write_inverse_operational_inertias(operator: ContactOperator, out: Array) -> None:
    """Write (n, 6, 6) inverse operational-space inertias: accelerations per wrench of each module.

    With X, which shifts a motion from module i − 1 to module i, and P = (1 − S D⁻¹ Uᵀ) X,

        Λ⁻¹_i = P Λ⁻¹_(i−1) Pᵀ + S D⁻¹ Sᵀ

    (Kreutz-Delgado, Jain, Rodriguez: Recursive formulation of operational space control, 1992).
    """
    S, U, D = operator.aba.S, operator.aba.U, operator.aba.D
    hinges = S.shape[1]
    last = hinges - 1
    out[0] = operator.inverse_root_inertia
    propagator = np.empty((6, 6))
    for i in range(1, operator.positions.shape[0]):
        x, y, z = link_vector(operator.positions, i)
        propagator[:] = 0.0
        for r in range(6):
            propagator[r, r] = 1.0
        propagator[3, 1], propagator[3, 2] = z, -y
        propagator[4, 0], propagator[4, 2] = -z, x
        propagator[5, 0], propagator[5, 1] = y, -x
        if i > operator.rigid_links:
            projection = np.eye(6)
            for k in range(6):
                s, t = solve_joint(D[i], U[i, 0, k], U[i, last, k])
                for r in range(6):
                    projection[r, k] -= S[i, 0, r] * s
                    if hinges == 2:
                        projection[r, k] -= S[i, 1, r] * t
            propagator = projection @ propagator
        out[i] = propagator @ out[i - 1] @ propagator.T
        if i > operator.rigid_links:
            for k in range(6):
                s, t = solve_joint(D[i], S[i, 0, k], S[i, last, k])
                for r in range(6):
                    out[i, r, k] += S[i, 0, r] * s
                    if hinges == 2:
                        out[i, r, k] += S[i, 1, r] * t


@njit(**INNER)
def _apply_delassus(
    x: Array, scale: Array, R: Array, contacts: PairContacts, operator: ContactOperator
) -> Array:
    """Return the (m,) product of scale (A + R) scale with x, A not being written down.

    Args:
        x: (m,) vector.
        scale: (m,) diagonal of the scaling.
        R: (m,) diagonal of the regularisation.
        contacts, operator: The contacts, and the response of the chain.
    """
    n, hinges = operator.aba.S.shape[0], operator.aba.S.shape[1]
    forces = scale * x
    response = np.empty((n, 6))
    discarded = np.zeros(n * hinges)
    wrenches = np.zeros((n, 6))
    _add_contact_forces(forces, contacts, operator.positions, wrenches)
    _propagate_wrenches(wrenches, operator.last, operator.last, operator, response, discarded)
    product = R * forces
    for k in range(forces.shape[0]):
        product[k] += _normal_velocity(k, contacts, operator.positions, response)
    return scale * product


@njit(**INNER)
def _solve_lcp_gradient(
    b: Array, diagonals: Array, contacts: PairContacts, operator: ContactOperator, f: Array
) -> None:
    """Write the f of ``_solve_lcp_block_pivoting`` approximately, without the matrix.

    By Nesterov's accelerated projected gradients with restarts (Mazhar, Heyn, Negrut, Tasora: Using
    Nesterov's method to accelerate multibody dynamics with friction and contact, 2015), scaled so
    that the diagonal is one. The response to all forces costs as much as that to one.

    Args:
        b: (m,) bias.
        diagonals: (2, m) diagonals of A and of R.
        contacts, operator: The contacts, and the response of the chain.
        f: (m,) written.
    """
    m = b.shape[0]
    R = diagonals[1]
    scale = 1.0 / np.sqrt(diagonals[0] + R)
    scaled = b * scale
    x = np.ones(m)
    eigenvalue = 1.0
    for _ in range(12):
        x /= np.sqrt((x * x).sum())
        x = _apply_delassus(x, scale, R, contacts, operator)
        eigenvalue = max(eigenvalue, np.sqrt((x * x).sum()))
    step = 1.0 / (1.3 * eigenvalue)  # power iteration finds it from below
    x = np.zeros(m)
    y = np.zeros(m)
    theta = 1.0
    tolerance = 1e-3 * np.abs(scaled).max()
    for _ in range(400):
        gradient = _apply_delassus(y, scale, R, contacts, operator) + scaled
        x_next = np.maximum(y - step * gradient, 0.0)
        if np.abs(y - x_next).max() < step * tolerance:
            x = x_next
            break
        theta_next = 0.5 * theta * (np.sqrt(theta * theta + 4.0) - theta)
        if (gradient * (x_next - x)).sum() > 0.0:
            theta = 1.0
            y = x_next.copy()
        else:
            y = x_next + theta * (1.0 - theta) / (theta * theta + theta_next) * (x_next - x)
            theta = theta_next
        x = x_next
    f[:] = x * scale
