"""Window body: the stretch of a long chain that is neither folded nor straight, in MuJoCo.

One tree, which floats: a rigid core of all modules that are folded already, the cubes of the
window with their hinges, and a rigid rod of all that are still straight. Its root is in the middle,
so that MuJoCo's matrix falls into two blocks: a quarter of the work. A model has a number of joints
and is used for all stretches of that length: the joints of a cube chain are all alike, so only the
core's and the rod's mass, inertia and shape are told anew.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.kinematics import forward_kinematics
from planner.chain.rotations import matrix_from_wxyz, wxyz_from_matrix
from planner.simulation.model import (
    Material,
    add_module_geom,
    add_next_body,
    add_previous_body,
    base_spec,
    compiled,
    exclude,
    hinge_names,
    set_inertia,
)
from planner.simulation.mujoco import mujoco

Array = NDArray[np.float64]
CORE_SHAPE, ROD_SHAPE = "core", "rod"
"""Bodies that carry a rigid part's geoms alone: MuJoCo keeps the bounds of geoms in the frame of
their body's inertia, which changes with the part's modules."""
CONTACT_STEPS: Final = 2.0
"""Time constant of contacts in steps, MuJoCo's limit of stability."""
IN_CORE, LINKED, MOVING = 1, 2, 4
"""MuJoCo's contact bits: of the core's cubes, of the one that the window is linked to, and of the
window and the rod."""
ROOT: Final = 1
_AT_ORIGIN: Final = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lump:
    """A rigid part in some frame.

    Attributes:
        mass: In module masses.
        centre: (3,) its centre of mass.
        inertia: (3, 3) about that centre.
    """

    mass: float
    centre: Array
    inertia: Array


class Lumps:
    """The core and the rod of a chain for every place of its window.

    Args:
        chain: A chain of cubes.
        masses: (n,) of its modules.
    """

    def __init__(self, chain: Chain, masses: Array) -> None:
        self.masses = masses
        self._folded = forward_kinematics(chain.module, chain.folded_rad)
        self._straight = forward_kinematics(chain.module, np.zeros_like(chain.folded_rad))
        inertia = chain.module.inertia
        self._core = _moments(masses, inertia, self._folded.positions, self._folded.rotations)
        straight = (self._straight.positions[::-1], self._straight.rotations[::-1])
        back = _moments(masses[::-1], inertia, *straight)
        self._rod = tuple(sums[::-1] for sums in back)

    def core(self, last: int) -> Lump:
        """Modules 0 to ``last``, folded, in the frame of that one."""
        return _lump([sums[last] for sums in self._core], *self.folded_pose(last))

    def rod(self, first: int) -> Lump:
        """Modules from ``first`` on, straight, in the frame of that one."""
        straight = self._straight
        return _lump(
            [sums[first] for sums in self._rod],
            straight.positions[first],
            straight.rotations[first],
        )

    def folded_pose(self, module: int) -> tuple[Array, Array]:
        """(3,) and (3, 3) where a folded module is in the frame of module 0."""
        return self._folded.positions[module], self._folded.rotations[module]


def _moments(
    masses: Array, inertia: Array, positions: Array, rotations: Array
) -> tuple[Array, Array, Array]:
    """(n,), (n, 3) and (n, 3, 3) mass, first and second moment of modules up to each one."""
    own = (rotations * inertia) @ rotations.transpose(0, 2, 1)
    squares = (positions**2).sum(axis=1)
    about = squares[:, None, None] * np.eye(3) - positions[:, :, None] * positions[:, None, :]
    return (
        np.cumsum(masses),
        np.cumsum(masses[:, None] * positions, axis=0),
        np.cumsum(masses[:, None, None] * (own + about), axis=0),
    )


def _lump(moments: list[Any], position: Array, rotation: Array) -> Lump:
    """Of mass, first and second moment, in a frame at some pose."""
    mass, first, second = moments
    centre = first / mass
    about = mass * ((centre @ centre) * np.eye(3) - np.outer(centre, centre))
    return Lump(
        mass=float(mass),
        centre=rotation.T @ (centre - position),
        inertia=rotation.T @ (second - about) @ rotation,
    )


class WindowBody:
    """A model of so many joints, and its data.

    Args:
        chain: The chain.
        joints: Between the core and the rod.
        geom_size: Size of the colliding modules as a fraction of the pitch.
        step_s: Time step.
    """

    def __init__(self, chain: Chain, joints: int, *, geom_size: float, step_s: float) -> None:
        self.chain = chain
        self.joints = joints
        self._size = geom_size
        material = Material(geom_size=geom_size, contact_time_constant=CONTACT_STEPS * step_s)
        self.model: Any = compiled(_spec(chain, joints, material))
        self.model.opt.timestep = step_s
        self.data: Any = mujoco.MjData(self.model)
        model = self.model
        names = [name for joint in range(joints) for name in hinge_names(chain, joint + 1)]
        self.dofs = np.array([model.joint(name).dofadr[0] for name in names])
        """(H,) where the hinges' velocities are among the model's; angles are one place behind."""
        self._cubes = np.array([model.body(_name(place)).id for place in range(1, joints)], int)
        self._core, self._core_shape = model.body(_name(0)).id, model.body(CORE_SHAPE).id
        self._rod, self._rod_shape = model.body(_name(joints)).id, model.body(ROD_SHAPE).id
        self._rod_geom = int(model.body_geomadr[self._rod_shape])
        self._first_geom = int(model.body_geomadr[self._core_shape])

    def copy(self) -> WindowBody:
        """A body of the same chain that shares nothing that changes with this one."""
        twin = copy(self)
        twin.model = copy(self.model)
        twin.data = mujoco.MjData(twin.model)
        return twin

    def take(self, first: int, lumps: Lumps) -> None:
        """Tells which stretch of the chain it is.

        Args:
            first: Joint that is the model's first one: between the modules ``first + 1`` and
                ``first + 2`` of the chain.
            lumps: Of the robot.
        """
        model, chain = self.model, self.chain
        core, rod = first + 1, first + 1 + self.joints
        position, rotation = lumps.folded_pose(core)
        model.body_pos[self._core_shape] = -rotation.T @ position
        model.body_quat[self._core_shape] = wxyz_from_matrix(rotation.T)
        self._set_lump(self._core, lumps.core(core))
        self._set_lump(self._rod, lumps.rod(rod))
        masses = lumps.masses[core + 1 : rod]
        model.body_mass[self._cubes] = masses
        model.body_inertia[self._cubes] = masses[:, None] * chain.module.inertia
        model.body_subtreemass[:] = model.body_mass
        for body in range(model.nbody - 1, 0, -1):
            model.body_subtreemass[model.body_parentid[body]] += model.body_subtreemass[body]
        bits = model.geom_contype[self._first_geom : self._first_geom + len(chain)]
        bits[:] = 0
        bits[:core] = IN_CORE
        bits[core] = LINKED
        length = len(chain) - rod
        half = np.array([0.5 * length, 0.5, 0.5]) - 0.5 * (1.0 - self._size)
        geom, shape = self._rod_geom, self._rod_shape
        model.body_pos[shape] = [0.5 * (length - 1), 0.0, 0.0]
        model.geom_size[geom] = half
        model.geom_rbound[geom] = np.linalg.norm(half)
        model.geom_aabb[geom, 3:] = half
        model.bvh_aabb[model.body_bvhadr[shape], 3:] = half

    def _set_lump(self, body: int, lump: Lump) -> None:
        moments, axes = np.linalg.eigh(lump.inertia)
        if np.linalg.det(axes) < 0.0:
            axes[:, 0] *= -1.0
        model = self.model
        model.body_mass[body] = lump.mass
        model.body_ipos[body] = lump.centre
        model.body_iquat[body] = wxyz_from_matrix(axes)
        model.body_inertia[body] = moments

    def place(self, core: tuple[Array, Array], angles: Array) -> None:
        """Sets a configuration, at rest.

        Args:
            core: (3,) centre and (4,) orientation of module 0.
            angles: (H,) of its hinges.
        """
        data = self.data
        data.qvel[:] = 0.0
        data.qpos[:7] = _AT_ORIGIN
        data.qpos[self.dofs + 1] = angles
        position, wxyz = self.core_pose()
        rotation = matrix_from_wxyz(core[1]) @ matrix_from_wxyz(wxyz).T
        data.qpos[:3] = core[0] - rotation @ position
        data.qpos[3:7] = wxyz_from_matrix(rotation)

    def core_pose(self) -> tuple[Array, Array]:
        """(3,) centre and (4,) orientation of module 0."""
        mujoco.mj_kinematics(self.model, self.data)
        shape = self._core_shape
        return self.data.xpos[shape].copy(), self.data.xquat[shape].copy()

    def move(self, rates: Array) -> None:
        """Sets the (H,) hinge velocities; the rest moves so that there is no momentum."""
        model, data = self.model, self.data
        data.qvel[:6] = 0.0
        data.qvel[self.dofs] = rates
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeM(model, data)
        mujoco.mj_comVel(model, data)
        self.take_momentum()

    def take_momentum(self) -> Array:
        """Takes the momentum away that the velocities have; (3,) the centre of mass.

        MuJoCo must know the composite inertias and the velocities of all bodies.
        """
        model, data = self.model, self.data
        mujoco.mj_subtreeVel(model, data)
        centre = data.subtree_com[ROOT].copy()
        xx, yy, zz, xy, xz, yz = data.crb[ROOT][:6]
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        x, y, z = turn = np.linalg.solve(inertia, data.subtree_angmom[ROOT])
        a, b, c = data.xpos[ROOT] - centre
        data.qvel[:3] -= data.subtree_linvel[ROOT]
        data.qvel[:3] -= (y * c - z * b, z * a - x * c, x * b - y * a)
        data.qvel[3:6] -= data.xmat[ROOT].reshape(3, 3).T @ turn
        return centre

    def floating_torques(self, angles: Array, rates: Array, accelerations: Array) -> Array:
        """(H,) torques for a motion of the hinges, of a body that floats without momentum.

        The first six coordinates are the root's, which nothing drives: M_bb a + M_bh q̈ + c_b = 0.

        Args:
            angles, rates, accelerations: (H,).
        """
        model, data, dofs = self.model, self.data, self.dofs
        data.qpos[:7] = _AT_ORIGIN
        data.qpos[dofs + 1] = angles
        self.move(rates)
        mujoco.mj_comVel(model, data)
        motion = np.zeros(model.nv)
        motion[dofs] = accelerations
        data.qacc[:] = motion
        wrench = np.empty(model.nv)
        mujoco.mj_rne(model, data, 1, wrench)
        # The same with the root's acceleration, found by what its six columns do.
        base = np.empty((6, 6))
        across = np.empty(model.nv)
        for k in range(6):
            unit = np.zeros(model.nv)
            unit[k] = 1.0
            mujoco.mj_mulM(model, data, across, unit)
            base[:, k] = across[:6]
        motion[:6] = -np.linalg.solve(base, wrench[:6])
        data.qacc[:] = motion
        mujoco.mj_rne(model, data, 1, wrench)
        return wrench[dofs]


def _name(place: int) -> str:
    """Of the module behind so many joints: 0 is the core's last, the last is the rod's first."""
    return f"module_{place + 1}"


def _spec(chain: Chain, joints: int, material: Material) -> Any:
    spec = base_spec()
    module = chain.module
    middle = joints // 2
    root = spec.worldbody.add_body()
    root.name = _name(middle)
    root.add_freejoint()
    bodies: dict[int, Any] = {middle: root}
    for place in range(middle + 1, joints + 1):
        before = bodies[place - 1]
        bodies[place] = add_next_body(before, chain, place + 1, _name(place), material)
    for place in range(middle - 1, -1, -1):
        behind = bodies[place + 1]
        bodies[place] = add_previous_body(behind, chain, place + 1, _name(place), material)
    names = [_name(place) for place in range(joints + 1)]
    for place in (0, joints):
        _set_any_inertia(bodies[place])
        bodies[place] = bodies[place].add_body()
        bodies[place].name = names[place] = ROD_SHAPE if place else CORE_SHAPE
    for place in range(1, joints + 1):
        if place < joints:
            set_inertia(bodies[place], module, 1.0)
        geom = add_module_geom(bodies[place], module, len(chain) + place, material)
        geom.contype = MOVING
        geom.conaffinity = IN_CORE | MOVING | (LINKED if place > 1 else 0)
    folded = forward_kinematics(module, chain.folded_rad)
    for i, (position, rotation) in enumerate(zip(folded.positions, folded.rotations, strict=True)):
        geom = add_module_geom(bodies[0], module, i, material)
        geom.pos, geom.quat = position.tolist(), wxyz_from_matrix(rotation).tolist()
        geom.contype, geom.conaffinity = IN_CORE, 0
    exclude(spec, names[1:], pairwise(range(joints)))
    return spec


def _set_any_inertia(body: Any) -> None:
    """An inertia that MuJoCo takes for nothing special: the real one is told later."""
    body.explicitinertial = True
    body.mass = 1.0
    body.ipos = [0.1, 0.2, 0.3]
    body.iquat = [0.5, 0.5, 0.5, 0.5]
    body.inertia = [1.0, 1.1, 1.2]
