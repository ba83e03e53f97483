"""Forward dynamics of a free chain, compiled: linear in its modules.

Featherstone's articulated-body algorithm (Rigid Body Dynamics Algorithms, 2008, chapter 7), with
all vectors in the world's frame and each module's taken at its centre: the wrench that the joint
before module j gives it is A_j a_j + b_j, where a_j holds its angular and linear acceleration, A_j
is its articulated inertia, (6, 6), and b_j what does not depend on accelerations.

``free_accelerations`` is for a chain that touches nothing. What it has found on its way inwards is
enough to tell how the chain answers to any force, which ``add_contacts`` makes use of.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import INNER, KERNEL, ZERO
from planner.kernels.dynamics import joint_axes
from planner.kernels.kinematics import copy_matrix, copy_vector
from planner.kernels.module import Joint
from planner.kernels.velocities import cross

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
HELD = 1e15
"""Inertia of a module that is held."""
NO_ROD: Array = np.zeros(4)
MOST_ROUNDS = 100
"""Of exchanging the contacts that push."""
PATIENCE = 3
"""Exchanges of all that are wrong, without fewer being so, before it is one at a time."""
EXACT = 1e-10
"""Share of the largest acceleration lacking up to which one counts as zero."""
MOST_GRADIENTS = 400
"""Steps of projected gradients."""
MIN_SOFTNESS = 1e-15
"""Least element of the diagonal R: without one A may be singular."""
NEARLY = 1e-3
"""Share of the largest acceleration lacking, below which they end."""


class Articulated(NamedTuple):
    """What a chain's inertias make of the joint before each of n modules of H hinges.

    Attributes:
        motions: (n, H, 6) accelerations that a unit acceleration of a hinge gives its module.
        wrenches: (n, H, 6) articulated inertia times those.
        hinges: (n, H, H) inertia that the hinges feel.
        base: (6, 6) articulated inertia of module 0.
        first: (6,) acceleration of module 0, angular first.
    """

    motions: Array
    wrenches: Array
    hinges: Array
    base: Array
    first: Array


class Contacts(NamedTuple):
    """Where modules touch.

    Attributes:
        pairs: (m, 2) modules; the normal points to the second one.
        normals, points: (m, 3) in the world.
    """

    pairs: Ints
    normals: Array
    points: Array


class Response(NamedTuple):
    """What it takes to tell how a chain answers to forces.

    Attributes:
        found: From ``free_accelerations``.
        inverse: (6, 6) inverse of ``found.base``.
        rigid_links: Links without hinges at the chain's beginning.
        positions: (n, 3).
        top: The last module that a force acts on.
    """

    found: Articulated
    inverse: Array
    rigid_links: int
    positions: Array
    top: int


def articulated(modules: int, hinges: int) -> Articulated:
    """Room for a chain of so many modules with so many hinges a joint."""
    return Articulated(
        np.zeros((modules, hinges, 6)),
        np.zeros((modules, hinges, 6)),
        np.zeros((modules, hinges, hinges)),
        np.zeros((6, 6)),
        np.zeros(6),
    )


@njit(**INNER)
def _alone(rotation: Array, inertia: Array, spin: Array, force: Array, a: Array, b: Array) -> None:
    """Writes A and b of a module of mass 1 that nothing hangs on."""
    a[:] = 0.0
    for r in range(3):
        for c in range(3):
            for k in range(3):
                a[r, c] += rotation[r, k] * inertia[k] * rotation[c, k]
        a[3 + r, 3 + r] = 1.0
    x = a[0, 0] * spin[0] + a[0, 1] * spin[1] + a[0, 2] * spin[2]
    y = a[1, 0] * spin[0] + a[1, 1] * spin[1] + a[1, 2] * spin[2]
    z = a[2, 0] * spin[0] + a[2, 1] * spin[1] + a[2, 2] * spin[2]
    b[0] = spin[1] * z - spin[2] * y
    b[1] = spin[2] * x - spin[0] * z
    b[2] = spin[0] * y - spin[1] * x
    for r in range(3):
        b[3 + r] = -force[r]


@njit(**INNER)
def _add_rod(rotation: Array, rod: Array, spin: Array, torque: Array, a: Array, b: Array) -> None:
    """Adds to A and b of the last module those of a rod fixed to it, and of a torque on it."""
    for r in range(3):
        b[r] -= torque[r]
    mass = rod[0]
    if mass == 0.0:
        return
    arm = np.empty(3)
    own = np.zeros((3, 3))
    for r in range(3):
        arm[r] = rotation[r, 0] * rod[1]
        for c in range(3):
            for k in range(3):
                own[r, c] += rotation[r, k] * rod[2 if k == 0 else 3] * rotation[c, k]
    pull = np.zeros(3)
    _centripetal(spin, arm, pull)
    square = arm[0] ** 2 + arm[1] ** 2 + arm[2] ** 2
    turning = own @ spin
    work = np.empty(3)
    cross(spin, turning, work)
    for r in range(3):
        b[r] += work[r]
        b[3 + r] += mass * pull[r]
        a[3 + r, 3 + r] += mass
        a[r, r] += mass * square
        for c in range(3):
            a[r, c] += own[r, c] - mass * arm[r] * arm[c]
    cross(arm, pull, work)
    for r in range(3):
        b[r] += mass * work[r]
    x, y, z = mass * arm[0], mass * arm[1], mass * arm[2]
    # The force that turning asks for is −m [r]× α, the torque that moving does m [r]× a.
    a[0, 4] -= z
    a[0, 5] += y
    a[1, 3] += z
    a[1, 5] -= x
    a[2, 3] -= y
    a[2, 4] += x
    a[4, 0] -= z
    a[5, 0] += y
    a[3, 1] += z
    a[5, 1] -= x
    a[3, 2] -= y
    a[4, 2] += x


@njit(**INNER)
def _centripetal(spin: Array, arm: Array, out: Array) -> None:
    """Adds ω × (ω × arm) to ``out``."""
    along = spin[0] * arm[0] + spin[1] * arm[1] + spin[2] * arm[2]
    square = spin[0] * spin[0] + spin[1] * spin[1] + spin[2] * spin[2]
    for r in range(3):
        out[r] += spin[r] * along - arm[r] * square


@njit(**INNER)
def _add_shifted(work: Array, b: Array, r: Array, a_out: Array, b_out: Array) -> None:
    """Adds Tᵀ A T and Tᵀ b for a module whose parent's centre is −r from its own.

    T is the map of accelerations (α, p̈) to (α, p̈ + α × r). What was in ``work``, A, is lost.
    """
    for row in range(6):
        # A T: of the angular columns, the linear ones times −[r]×.
        x, y, z = work[row, 3], work[row, 4], work[row, 5]
        work[row, 0] += r[1] * z - r[2] * y
        work[row, 1] += r[2] * x - r[0] * z
        work[row, 2] += r[0] * y - r[1] * x
    for column in range(6):
        x, y, z = work[3, column], work[4, column], work[5, column]
        work[0, column] += r[1] * z - r[2] * y
        work[1, column] += r[2] * x - r[0] * z
        work[2, column] += r[0] * y - r[1] * x
    for row in range(6):
        for column in range(6):
            a_out[row, column] += work[row, column]
    x, y, z = b[3], b[4], b[5]
    b_out[0] += b[0] + r[1] * z - r[2] * y
    b_out[1] += b[1] + r[2] * x - r[0] * z
    b_out[2] += b[2] + r[0] * y - r[1] * x
    for k in range(3, 6):
        b_out[k] += b[k]


@njit(**INNER)
def _solved(d: Array, u: Array) -> tuple[float, float]:
    """D⁻¹ u for one or two hinges."""
    if u.shape[0] == 1:
        return u[0] / d[0, 0], 0.0
    whole = d[0, 0] * d[1, 1] - d[0, 1] * d[1, 0]
    return (
        (d[1, 1] * u[0] - d[0, 1] * u[1]) / whole,
        (d[0, 0] * u[1] - d[1, 0] * u[0]) / whole,
    )


@njit(**KERNEL)
def free_accelerations(
    angles: Array,
    rates: Array,
    torques: Array,
    forces: Array,
    joint: Joint,
    inertia: Array,
    armature: Array,
    rod: Array,
    end_torque: Array,
    fixed: bool,
    root: int,
    positions: Array,
    rotations: Array,
    spins: Array,
    found: Articulated,
    hinges_out: Array,
    root_out: Array,
) -> None:
    """Writes the (J,) hinge accelerations and (6,) the root's, angular first, in the world.

    Args:
        angles, rates, torques: (J,) of the hinges.
        forces: (n, 3) at the centres, in the world.
        joint, inertia: Of the module, whose mass is 1.
        armature: (J,) rotor inertias of the hinges.
        rod: (4,) of a rod along the last module's x axis, fixed to it: its mass, how far from the
            module's centre its own is, and its inertia about that, along and across; ``NO_ROD``.
        end_torque: (3,) on the last module, in the world.
        fixed: Whether module 0 is held.
        root: The module whose acceleration is wanted.
        positions, rotations, spins: Of all modules, in the world.
        found: Where to write what the inertias are.
        hinges_out, root_out: Where to write.
    """
    rigid_links, anchor, axes = joint.rigid_links, joint.anchor, joint.axes
    n = positions.shape[0]
    hinges = axes.shape[0]
    a, inner_a = np.empty((6, 6)), np.empty((6, 6))
    b, inner_b = np.empty(6), np.empty(6)
    c = np.zeros((n, 6))
    s, us, d = found.motions, found.wrenches, found.hinges
    us[:] = 0.0
    d[:] = 0.0
    u = np.zeros((n, hinges))
    spin = np.empty(3)
    arm = np.empty(3)
    work = np.empty(3)
    without = np.empty((6, 6))
    bias = np.empty(6)
    _alone(rotations[n - 1], inertia, spins[n - 1], forces[n - 1], a, b)
    _add_rod(rotations[n - 1], rod, spins[n - 1], end_torque, a, b)
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
            copy_vector(spins[i - 1], spin)
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
            bias[row] = b[row]
            for k in range(6):
                bias[row] += a[row, k] * c[i, k]
        copy_matrix(a, without)
        if j >= 0:
            for h in range(hinges):
                u[i, h] = torques[j + h]
                for row in range(6):
                    u[i, h] -= s[i, h, row] * bias[row]
                    for k in range(6):
                        us[i, h, row] += a[row, k] * s[i, h, k]
            for h in range(hinges):
                d[i, h, h] = armature[j + h]
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
        _alone(rotations[i - 1], inertia, spins[i - 1], forces[i - 1], inner_a, inner_b)
        _add_shifted(without, bias, arm, inner_a, inner_b)
        a, inner_a = inner_a, a
        b, inner_b = inner_b, b
    moved = np.zeros(6)
    finite = True
    for row in range(6):
        moved[row] = -b[row]
        finite = finite and np.isfinite(b[row])
        for k in range(6):
            finite = finite and np.isfinite(a[row, k])
    if not finite:
        hinges_out[:] = np.nan
        return
    if fixed:
        for row in range(6):
            moved[row] = 0.0
            for k in range(6):
                a[row, k] = HELD if row == k else 0.0
    else:
        base: Array = np.linalg.solve(a, moved)  # pyright: ignore[reportAssignmentType]
        copy_vector(base, moved)
    copy_matrix(a, found.base)
    copy_vector(moved, found.first)
    if root == 0:
        copy_vector(moved, root_out)
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
            copy_vector(moved, root_out)


@njit(**INNER)
def _carry(acceleration: Array, arm: Array, work: Array) -> None:
    """Takes an acceleration (angular first) from a place to another one ``arm`` away, at rest."""
    cross(acceleration[:3], arm, work)
    for r in range(3):
        acceleration[3 + r] += work[r]


@njit(**INNER)
def _respond(
    wrenches: Array,
    last: int,
    top: int,
    found: Articulated,
    inverse: Array,
    rigid_links: int,
    positions: Array,
    out: Array,
    hinges_out: Array,
) -> None:
    """Adds the accelerations that wrenches alone give a chain at rest.

    Args:
        wrenches: (n, 6) on the modules at their centres, torque first; none beyond ``last``.
        last: The last module with a wrench.
        top: The last module whose acceleration is wanted.
        found: From ``free_accelerations``.
        inverse: (6, 6) inverse of ``found.base``.
        rigid_links: Links without hinges at the chain's beginning.
        positions: (n, 3).
        out: (n, 6) of the modules, angular first; written up to ``top``.
        hinges_out: (J,) to which the hinges' are added, up to ``top``.
    """
    s, us, d = found.motions, found.wrenches, found.hinges
    hinges = s.shape[1]
    u = np.zeros((last + 1, hinges))
    bias = np.zeros(6)
    arm = np.empty(3)
    work = np.empty(3)
    for i in range(last, 0, -1):
        for k in range(6):
            bias[k] -= wrenches[i, k]
        if i > rigid_links:
            for h in range(hinges):
                for k in range(6):
                    u[i, h] -= s[i, h, k] * bias[k]
            x, y = _solved(d[i], u[i])
            for k in range(6):
                bias[k] += us[i, 0, k] * x
                if hinges == 2:
                    bias[k] += us[i, 1, k] * y
        for r in range(3):
            arm[r] = positions[i, r] - positions[i - 1, r]
        cross(arm, bias[3:], work)
        for r in range(3):
            bias[r] += work[r]
    moved = np.zeros(6)
    for k in range(6):
        for m in range(6):
            moved[k] += inverse[k, m] * (wrenches[0, m] - bias[m])
    copy_vector(moved, out[0])
    for i in range(1, top + 1):
        for r in range(3):
            arm[r] = positions[i, r] - positions[i - 1, r]
        _carry(moved, arm, work)
        if i > rigid_links:
            j = (i - 1 - rigid_links) * hinges
            for h in range(hinges):
                work[h] = u[i, h] if i <= last else 0.0
                for k in range(6):
                    work[h] -= us[i, h, k] * moved[k]
            x, y = _solved(d[i], work[:hinges])
            hinges_out[j] += x
            if hinges == 2:
                hinges_out[j + 1] += y
            for k in range(6):
                moved[k] += s[i, 0, k] * x
                if hinges == 2:
                    moved[k] += s[i, 1, k] * y
        copy_vector(moved, out[i])


@njit(**INNER)
def _closing(
    first: int, second: int, normal: Array, point: Array, positions: Array, moved: Array
) -> float:
    """How fast (n, 6) motions of modules part two of them at a point of both."""
    arm = np.empty(3)
    turn = np.empty(3)
    found = 0.0
    for module, sign in ((first, -1.0), (second, 1.0)):
        for r in range(3):
            arm[r] = point[r] - positions[module, r]
        cross(moved[module, :3], arm, turn)
        for r in range(3):
            found += sign * normal[r] * (moved[module, 3 + r] + turn[r])
    return found


@njit(**INNER)
def _push(
    first: int, second: int, normal: Array, point: Array, positions: Array, by: float, out: Array
) -> None:
    """Adds to (n, 6) wrenches those of a force between two modules at a point."""
    arm = np.empty(3)
    turn = np.empty(3)
    for module, sign in ((first, -by), (second, by)):
        for r in range(3):
            arm[r] = point[r] - positions[module, r]
        cross(arm, normal, turn)
        for r in range(3):
            out[module, r] += sign * turn[r]
            out[module, 3 + r] += sign * normal[r]


@njit(**INNER)
def _complementary(a: Array, lack: Array, forces: Array) -> bool:
    """Writes the f ≥ 0 with A f + lack ≥ 0 of which one is zero everywhere; whether it was found.

    By block principal pivoting (Júdice and Pires, Computers & Operations Research 21, 1994), which
    ends for every positive definite (m, m) matrix A.
    """
    m = lack.shape[0]
    pushing = np.empty(m, np.bool_)
    wrong = np.empty(m, np.bool_)
    chosen = np.empty(m, np.int64)
    slack = 0.0
    for k in range(m):
        pushing[k] = lack[k] < 0.0
        slack = max(slack, EXACT * abs(lack[k]))
    fewest, patience = m + 1, PATIENCE
    for _ in range(MOST_ROUNDS):
        size = ZERO
        for k in range(m):
            forces[k] = 0.0
            if pushing[k]:
                chosen[size] = k
                size += 1
        part = np.empty((size, size))
        push = np.empty(size)
        for r in range(size):
            push[r] = -lack[chosen[r]]
            for c in range(size):
                part[r, c] = a[chosen[r], chosen[c]]
        if size:
            push = np.linalg.solve(part, push)
        for r in range(size):
            forces[chosen[r]] = push[r]
        answer = a @ forces
        count = ZERO
        last = ZERO
        for k in range(m):
            wrong[k] = forces[k] < 0.0 if pushing[k] else lack[k] + answer[k] < -slack
            if wrong[k]:
                count += 1
                last = k
        if count == 0:
            return True
        if count < fewest:
            fewest, patience = count, PATIENCE
        else:
            patience -= 1
        for k in range(m):
            if wrong[k] and (patience >= 0 or k == last):
                pushing[k] = not pushing[k]
    return False


@njit(**INNER)
def _mobilities(
    found: Articulated, inverse: Array, rigid_links: int, positions: Array, out: Array
) -> None:
    """Writes the (n, 6, 6) accelerations of each module that unit wrenches on it alone give it.

    What is at module i − 1, W, is at module i (1 − S D⁻¹ Uᵀ) W' (1 − S D⁻¹ Uᵀ)ᵀ + S D⁻¹ Sᵀ, with W'
    moved to its centre (Kreutz-Delgado, Jain, Rodriguez: Recursive formulation of operational space
    control, 1992).
    """
    s, us, d = found.motions, found.wrenches, found.hinges
    hinges = s.shape[1]
    out[0] = inverse
    arm = np.empty(3)
    along = np.empty((6, 6))
    for i in range(1, positions.shape[0]):
        for r in range(3):
            arm[r] = positions[i, r] - positions[i - 1, r]
        along[:] = 0.0
        for r in range(6):
            along[r, r] = 1.0
        along[3, 1], along[3, 2] = arm[2], -arm[1]
        along[4, 0], along[4, 2] = -arm[2], arm[0]
        along[5, 0], along[5, 1] = arm[1], -arm[0]
        if i > rigid_links:
            kept = np.eye(6)
            for k in range(6):
                x, y = _solved(d[i], us[i, :, k])
                for r in range(6):
                    kept[r, k] -= s[i, 0, r] * x
                    if hinges == 2:
                        kept[r, k] -= s[i, 1, r] * y
            along = kept @ along
        out[i] = along @ out[i - 1] @ along.T
        if i > rigid_links:
            for k in range(6):
                x, y = _solved(d[i], s[i, :, k])
                for r in range(6):
                    out[i, r, k] += s[i, 0, r] * x
                    if hinges == 2:
                        out[i, r, k] += s[i, 1, r] * y


@njit(**INNER)
def _pushed(forces: Array, contacts: Contacts, positions: Array, wrenches: Array) -> None:
    """Add to (n, 6) wrenches those that (m,) forces in the contacts add up to."""
    for k in range(forces.shape[0]):
        if forces[k] != 0.0:
            i, j = contacts.pairs[k, 0], contacts.pairs[k, 1]
            _push(i, j, contacts.normals[k], contacts.points[k], positions, forces[k], wrenches)


@njit(**INNER)
def _answers(
    x: Array, unit: Array, softness: Array, contacts: Contacts, response: Response
) -> Array:
    """(m,) product of A + R with forces, rows and forces in given units.

    Args:
        x: (m,) forces in those units.
        unit: (m,) the units.
        softness: (2, m) as in ``_many_contacts``.
        contacts, response: Of the chain.
    """
    found, inverse, rigid_links, positions, top = response
    forces = unit * x
    answer = np.empty((positions.shape[0], 6))
    nowhere = np.zeros(found.motions.shape[0] * found.motions.shape[1])
    wrenches = np.zeros((positions.shape[0], 6))
    _pushed(forces, contacts, positions, wrenches)
    _respond(wrenches, top, top, found, inverse, rigid_links, positions, answer, nowhere)
    out = softness[1] * forces
    for k in range(forces.shape[0]):
        i, j = contacts.pairs[k, 0], contacts.pairs[k, 1]
        out[k] += _closing(i, j, contacts.normals[k], contacts.points[k], positions, answer)
    return unit * out


@njit(**INNER)
def _many_contacts(
    lack: Array, softness: Array, contacts: Contacts, response: Response, forces: Array
) -> None:
    """Writes the forces of ``_complementary`` for many contacts, nearly, without the matrix.

    Nesterov's projected gradients, begun anew where they rise (Mazhar, Heyn, Negrut, Tasora: Using
    Nesterov's method to accelerate multibody dynamics, 2015), forces in units in which the
    diagonal is one. An answer of the chain to all forces costs as much as that to one.

    Args:
        lack: (m,) acceleration that each contact lacks.
        softness: (2, m) diagonal of A and of R.
        contacts, response: Of the chain.
        forces: (m,) written.
    """
    m = lack.shape[0]
    unit = 1.0 / np.sqrt(softness[0] + softness[1])
    wanted = lack * unit
    x = np.ones(m)
    largest = 1.0
    for _ in range(12):  # the largest eigenvalue, from below
        x /= np.sqrt((x * x).sum())
        x = _answers(x, unit, softness, contacts, response)
        largest = max(largest, np.sqrt((x * x).sum()))
    step = 1.0 / (1.3 * largest)
    x = np.zeros(m)
    y = np.zeros(m)
    theta = 1.0
    enough = NEARLY * np.abs(wanted).max()
    for _ in range(MOST_GRADIENTS):
        slope = _answers(y, unit, softness, contacts, response) + wanted
        later = np.maximum(y - step * slope, 0.0)
        if np.abs(y - later).max() < step * enough:
            x = later
            break
        following = 0.5 * theta * (np.sqrt(theta * theta + 4.0) - theta)
        if (slope * (later - x)).sum() > 0.0:
            theta = 1.0
            y = later.copy()
        else:
            y = later + theta * (1.0 - theta) / (theta * theta + following) * (later - x)
            theta = following
        x = later
    forces[:] = x * unit


@njit(**INNER)
def _moved_freely(
    found: Articulated,
    hinges_out: Array,
    rigid_links: int,
    positions: Array,
    top: int,
    moved: Array,
) -> None:
    """Write the (n, 6) accelerations of modules up to ``top`` where nothing touches.

    They lack what comes of velocities, as those of MuJoCo's rows do.
    """
    hinges = found.motions.shape[1]
    arm = np.empty(3)
    work = np.empty(3)
    copy_vector(found.first, moved[0])
    for i in range(1, top + 1):
        copy_vector(moved[i - 1], moved[i])
        for r in range(3):
            arm[r] = positions[i, r] - positions[i - 1, r]
        _carry(moved[i], arm, work)
        if i > rigid_links:
            for h in range(hinges):
                for k in range(6):
                    moved[i, k] += (
                        found.motions[i, h, k] * hinges_out[(i - 1 - rigid_links) * hinges + h]
                    )


@njit(**INNER)
def _speeds_of(contacts: Contacts, spins: Array, velocities: Array, speeds: Array) -> None:
    """Write the (n, 6) velocities of all modules that touch another one."""
    for k in range(contacts.pairs.shape[0]):
        for side in range(2):
            module = contacts.pairs[k, side]
            for r in range(3):
                speeds[module, r] = spins[module, r]
                speeds[module, 3 + r] = velocities[module, r]


@njit(**INNER)
def _impedance(depth: float, solimp: Array) -> float:
    """Return the impedance of a contact of some depth: MuJoCo's documentation, "solimp"."""
    least, most, width, middle, power = solimp
    x = min(depth / width, 1.0)
    y = x**power / middle ** (power - 1.0)
    if x > middle:
        y = 1.0 - (1.0 - x) ** power / (1.0 - middle) ** (power - 1.0)
    return least + y * (most - least)


@njit(**INNER)
def _lacking(
    k: int,
    contacts: Contacts,
    depth: float,
    impedance: float,
    solref: tuple[float, float],
    most: float,
    positions: Array,
    speeds: Array,
    moved: Array,
) -> float:
    """Return how much the acceleration at which a contact parts exceeds the one it should have.

    Args:
        k: Number of the contact.
        contacts: All contacts.
        depth, impedance: Of this one.
        solref: Time constant and damping ratio.
        most: Largest impedance.
        positions, speeds, moved: (n, 3), and (n, 6) velocities and free accelerations of modules.
    """
    constant, ratio = solref
    i, j = contacts.pairs[k, 0], contacts.pairs[k, 1]
    normal, point = contacts.normals[k], contacts.points[k]
    wanted = -2.0 / (most * constant) * _closing(i, j, normal, point, positions, speeds)
    wanted += impedance * depth / (most * constant * ratio) ** 2
    return _closing(i, j, normal, point, positions, moved) - wanted


@njit(**INNER)
def _top(contacts: Contacts) -> int:
    """Return the last module that touches another one."""
    top = ZERO
    for k in range(contacts.pairs.shape[0]):
        top = max(top, contacts.pairs[k, 0], contacts.pairs[k, 1])
    return top


@njit(**INNER)
def _without_contacts(
    contacts: Contacts,
    found: Articulated,
    hinges_out: Array,
    rigid_links: int,
    positions: Array,
    velocities: Array,
    spins: Array,
) -> tuple[int, Array, Array, Array]:
    """Return the last module that touches, the inverse of ``found.base``, and how modules move.

    The latter are (n, 6) free accelerations up to that module, and (n, 6) velocities.
    """
    n = positions.shape[0]
    inverse: Array = np.linalg.inv(found.base)  # pyright: ignore[reportAssignmentType]
    top = _top(contacts)
    moved = np.zeros((n, 6))
    _moved_freely(found, hinges_out, rigid_links, positions, top, moved)
    speeds = np.empty((n, 6))
    _speeds_of(contacts, spins, velocities, speeds)
    return top, inverse, moved, speeds


@njit(**KERNEL)
def add_contacts(
    contacts: Contacts,
    depths: Array,
    solref: tuple[float, float],
    solimp: Array,
    found: Articulated,
    joint: Joint,
    root: int,
    positions: Array,
    velocities: Array,
    spins: Array,
    hinges_out: Array,
    root_out: Array,
) -> bool:
    """Add to the free accelerations what contacts without friction do, solved exactly.

    MuJoCo's soft contacts (its documentation, "Computation", "Constraint model"): forces f ≥ 0
    along the normals with (A + R) f + a − a_ref ≥ 0, one of both zero in each. a are the
    accelerations at which the contacts would part without them, A the chain's answer to them.

    Args:
        contacts: m of them.
        depths: (m,) in pitches.
        solref: Time constant and damping ratio.
        solimp: (5,) impedance.
        found: From ``free_accelerations``.
        joint: Of the module.
        root: The module whose acceleration ``root_out`` is.
        positions, velocities, spins: Of all modules, in the world.
        hinges_out: (J,) from ``free_accelerations``.
        root_out: (6,) likewise.

    Returns:
        False if no solution was found, and nothing is added.
    """
    pairs, normals, points = contacts
    n, m = positions.shape[0], pairs.shape[0]
    rigid_links = joint.rigid_links
    top, inverse, moved, speeds = _without_contacts(
        contacts, found, hinges_out, rigid_links, positions, velocities, spins
    )
    answer = np.zeros((n, 6))
    nowhere = np.zeros(hinges_out.shape[0])
    wrenches = np.zeros((n, 6))
    lack = np.empty(m)
    a = np.empty((m, m))
    softness = np.empty(m)
    for k in range(m):
        i, j = pairs[k, 0], pairs[k, 1]
        _push(i, j, normals[k], points[k], positions, 1.0, wrenches)
        _respond(wrenches, max(i, j), top, found, inverse, rigid_links, positions, answer, nowhere)
        for g in range(m):
            a[g, k] = _closing(pairs[g, 0], pairs[g, 1], normals[g], points[g], positions, answer)
        for r in range(6):
            wrenches[i, r] = 0.0
            wrenches[j, r] = 0.0
        impedance = _impedance(depths[k], solimp)
        lack[k] = _lacking(
            k, contacts, depths[k], impedance, solref, solimp[1], positions, speeds, moved
        )
        softness[k] = max(a[k, k] * (1.0 - impedance) / impedance, MIN_SOFTNESS)
    for k in range(m):
        a[k, k] += softness[k]
    forces = np.zeros(m)
    if not _complementary(a, lack, forces):
        return False
    _pushed(forces, contacts, positions, wrenches)
    _respond(wrenches, top, n - 1, found, inverse, rigid_links, positions, answer, hinges_out)
    for r in range(6):
        root_out[r] += answer[root, r]
    return True


@njit(**KERNEL)
def add_many_contacts(
    contacts: Contacts,
    depths: Array,
    solref: tuple[float, float],
    solimp: Array,
    found: Articulated,
    joint: Joint,
    root: int,
    positions: Array,
    velocities: Array,
    spins: Array,
    hinges_out: Array,
    root_out: Array,
) -> None:
    """Do nearly as ``add_contacts`` without writing the contacts' matrix down.

    R is that of two modules that know nothing of each other, and the forces are those of
    ``_many_contacts``. The arguments are the same.
    """
    pairs, normals, points = contacts
    n, m = positions.shape[0], pairs.shape[0]
    rigid_links = joint.rigid_links
    top, inverse, moved, speeds = _without_contacts(
        contacts, found, hinges_out, rigid_links, positions, velocities, spins
    )
    mobilities = np.empty((n, 6, 6))
    _mobilities(found, inverse, rigid_links, positions, mobilities)
    wrenches = np.zeros((n, 6))
    lack = np.empty(m)
    softness = np.empty((2, m))
    for k in range(m):
        i, j = pairs[k, 0], pairs[k, 1]
        _push(i, j, normals[k], points[k], positions, 1.0, wrenches)
        softness[0, k] = (wrenches[i] * (mobilities[i] @ wrenches[i])).sum()
        softness[0, k] += (wrenches[j] * (mobilities[j] @ wrenches[j])).sum()
        wrenches[i] = 0.0
        wrenches[j] = 0.0
        impedance = _impedance(depths[k], solimp)
        lack[k] = _lacking(
            k, contacts, depths[k], impedance, solref, solimp[1], positions, speeds, moved
        )
        softness[1, k] = max(softness[0, k] * (1.0 - impedance) / impedance, MIN_SOFTNESS)
    forces = np.zeros(m)
    response = Response(found, inverse, rigid_links, positions, top)
    _many_contacts(lack, softness, contacts, response, forces)
    _pushed(forces, contacts, positions, wrenches)
    answer = np.zeros((n, 6))
    _respond(wrenches, top, n - 1, found, inverse, rigid_links, positions, answer, hinges_out)
    root_out += answer[root]
