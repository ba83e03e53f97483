"""Chains that stand on a floor, and a second formulation of their equilibrium."""

import numpy as np
from scipy.optimize import linprog

from foldback.planner.chain.cantilever_statics import hinge_frames
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import Poses
from foldback.planner.statics.balance import Standing
from foldback.planner.statics.contacts import Contacts
from foldback.planner.statics.friction import Friction, rays
from tests.planner.chains import Array


def standing(chain: Chain, lift: float = 0.5) -> tuple[Array, Array, Array]:
    """Return positions, rotations and angles of the folded chain; its z = 0 is on the floor."""
    poses = chain.folded_poses
    return poses.positions + [0.0, 0.0, lift], poses.rotations, chain.folded_rad


def by_joint_wrenches(
    chain: Chain,
    positions: Array,
    rotations: Array,
    angles: Array,
    contacts: Contacts,
    friction: Friction | None = None,
    clamped: int | None = None,
) -> float:
    """Return the minimal largest torque, with every module balanced by the wrenches of its joints.

    Unknowns are the contact forces, then force and moment at every link, then the torque.
    """
    chosen_contacts, forces = rays(contacts, friction, positions, rotations)
    module, n, pushes = chain.module, len(chain), len(chosen_contacts)
    axes, anchors = hinge_frames(chain, angles, Poses(positions=positions, rotations=rotations))
    links = n - 1
    unknowns = pushes + 6 * links + 1
    balance, load = np.zeros((6 * n, unknowns)), np.zeros(6 * n)
    load[2::6] = 1.0  # supports a module's weight

    def act(column: int, body: int, point: Array, force: Array, moment: Array | float) -> None:
        around = np.cross(point - positions[body], force) + moment
        balance[6 * body : 6 * body + 6, column] += np.concatenate([force, around])

    for r in range(pushes):
        c = int(chosen_contacts[r])
        for body, sign in ((contacts.first[c], 1.0), (contacts.second[c], -1.0)):
            if body >= 0:
                act(r, body, contacts.points[c], sign * forces[r], 0.0)
    for i in range(links):
        joint = i - module.rigid_links
        at = anchors[joint] if joint >= 0 else positions[i]
        for k, unit in enumerate(np.eye(6)):
            for body, sign in ((i + 1, 1.0), (i, -1.0)):
                act(pushes + 6 * i + k, body, at, sign * unit[:3], sign * unit[3:])
    rows = []
    for joint in range(len(anchors)):
        for axis in axes[joint]:
            row = np.zeros(unknowns)
            start = pushes + 6 * (joint + module.rigid_links) + 3
            row[start : start + 3] = axis
            rows += [row, -row]
    limits = np.array(rows)
    limits[:, -1] = -1.0
    cost = np.zeros(unknowns)
    cost[-1] = 1.0
    if clamped is not None:
        free = np.ones(6 * n, dtype=bool)
        free[6 * clamped : 6 * clamped + 6] = False
        balance, load = balance[free], load[free]
    solved = linprog(
        cost,
        A_ub=limits,
        b_ub=np.zeros(len(limits)),
        A_eq=balance,
        b_eq=load,
        bounds=[(0, None)] * pushes + [(None, None)] * (6 * links) + [(0, None)],
        method="highs",
    )
    return float(solved.fun) if solved.success else np.inf


def imbalance(chain: Chain, positions: Array, stands: Standing) -> float:
    """Return the force and moment by which the floor's forces fail to support the whole chain."""
    _, points, forces = stands.floor
    force = forces.sum(axis=0) - [0.0, 0.0, len(chain)]
    weights = np.tile([0.0, 0.0, -1.0], (len(chain), 1))
    moment = np.cross(points, forces).sum(axis=0) + np.cross(positions, weights).sum(axis=0)
    return float(max(np.abs(force).max(), np.abs(moment).max()))
