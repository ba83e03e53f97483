"""MuJoCo chain: the whole chain as one MuJoCo tree, whose motion MuJoCo computes.

It stands in for ``Segments`` in explosions with the setting ``engine=mujoco``: springs, stops,
contacts and the integration are MuJoCo's. A step costs the cube of the number of modules.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.rotations import matrix_from_wxyz, wxyz_from_matrix
from foldback.planner.errors import InputError, SimulationError
from foldback.planner.simulation.engine import SpringChain, build_chain_model
from foldback.planner.simulation.lazy_mujoco import mujoco
from foldback.planner.simulation.mujoco_models import Material
from foldback.planner.simulation.mujoco_tree import Tree
from foldback.planner.simulation.reduced_state import Acceleration, State

MAX_MUJOCO_MODULES: Final = 500
"""Maximum number of modules of a chain that MuJoCo simulates as one tree, with ``engine=mujoco``: a
step of 500 cubes takes 14 ms without contacts (decision 0058)."""


def refuse_long_chain(chain: Chain) -> None:
    """Raise ``InputError`` ``too-long-for-mujoco`` for a chain that is too long for one tree."""
    if len(chain) > MAX_MUJOCO_MODULES:
        raise InputError(
            "too-long-for-mujoco",
            "got a chain of {modules} modules with engine=mujoco, expected at most {limit}; use "
            "fewer modules, or leave out engine=mujoco.",
            modules=len(chain),
            limit=MAX_MUJOCO_MODULES,
        )


class MujocoChain(SpringChain):
    """Chain as one MuJoCo tree; the root is the middle module.

    Poses and velocities of modules, on which forces depend, are those of ``Engine``.

    Args:
        chain: The chain.
        material: Material of its joints and surfaces.
    """

    def __init__(self, chain: Chain, material: Material) -> None:
        super().__init__(chain, material, build_chain_model(chain, root=chain.root))
        self.tree = Tree(chain, material, step_s=1.0)  # each step sets its own
        option = self.tree.model.opt
        option.solver = mujoco.mjtSolver.mjSOL_NEWTON
        option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
        option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_DIAGEXACT)

    def set_contact_time_constant(self, seconds: float) -> None:
        """Set the time constant of all contacts, ``solref[0]``, s."""
        self.tree.model.geom_solref[:, 0] = seconds

    def set_stiffness(self, stiffness: Array) -> None:
        """Set the stiffness of the springs of (J,) hinges."""
        super().set_stiffness(stiffness)
        self.tree.model.jnt_stiffness[self.tree.indices.joints] = stiffness

    def set_rotor_inertias(self, inertias: Array) -> None:
        """Set the rotor inertias of (J,) hinges, module mass · pitch²."""
        super().set_rotor_inertias(inertias)
        self.tree.model.dof_armature[self.tree.indices.dofs] = inertias

    def set_step(self, step_s: float) -> None:
        """Set the time step, s, on which MuJoCo's constraints depend."""
        self.tree.model.opt.timestep = step_s

    def accelerations(self, state: State, forces: Array) -> Acceleration:
        """Return MuJoCo's acceleration of a state under forces on the modules.

        Args:
            state: The reduced state.
            forces: (n, 3) forces at the modules' centres, in the world frame.

        Raises:
            SimulationError: The accelerations are not finite.
        """
        model, data, at = self.tree.model, self.tree.data, self.tree.indices
        data.qpos[:3], data.qpos[3:7] = state.position, wxyz_from_matrix(state.rotation)
        data.qvel[:3], data.qvel[3:6] = state.velocity, state.spin
        data.qpos[at.qpos], data.qvel[at.dofs] = state.angles, state.rates
        data.xfrc_applied[at.bodies, :3] = forces
        mujoco.mj_forward(model, data)
        acceleration: Array = data.qacc
        if not np.isfinite(acceleration).all() or np.abs(acceleration).max() > 1e10:  # diverged
            raise SimulationError("the accelerations became infinite or undefined.")
        return Acceleration(
            hinges=acceleration[at.dofs],
            linear=acceleration[:3].copy(),
            angular=acceleration[3:6].copy(),
            contacts=int(data.ncon),
            depth=max(0.0, -float(data.contact.dist.min())) if data.ncon else 0.0,
        )

    def advance(self, state: State, step_s: float) -> None:
        """Let MuJoCo's Euler integrator make a step to the velocities of a state.

        These are those of MuJoCo's accelerations, less drag, and scaled to what a step allows: what
        is lost is a force −λ M q̇ more.

        Args:
            state: State whose positions are those of the last ``accelerations``; changed.
            step_s: Time step, s.
        """
        model, data, at = self.tree.model, self.tree.data, self.tree.indices
        self.set_step(step_s)
        velocities = np.empty(model.nv)
        velocities[:3], velocities[3:6] = state.velocity, state.spin
        velocities[at.dofs] = state.rates
        data.qacc[:] = (velocities - data.qvel) / step_s
        mujoco.mj_Euler(model, data)
        state.position, state.rotation = data.qpos[:3].copy(), matrix_from_wxyz(data.qpos[3:7])
        state.velocity, state.spin = data.qvel[:3].copy(), data.qvel[3:6].copy()
        state.angles, state.rates = self.tree.angles, self.tree.rates
