"""Segments: a free chain as MuJoCo trees of a few modules, welded end to end.

MuJoCo simulates them where contacts have friction, in the published explosion; in all others it
only finds the contacts, and ``planner.simulation.engine`` computes their forces. Only the reduced
state is integrated: all hinge angles and the pose of one root. Before every evaluation forward
kinematics writes the pose and velocity of every segment, so the welds are closed at every step.

In reduced coordinates a contact row asks J S q̈ = a_ref; MuJoCo's rows have J (S q̈ + Ṡ q̇) instead,
where S maps reduced to segment velocities. So J Ṡ q̇ is added to the reference of contact rows. Weld
rows keep theirs: MuJoCo's own −J̇ q̇ keeps the ends together.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.core import least_separation, write_root_velocities, write_state
from foldback.planner.core.structures import ModuleStates, PairContacts, SegmentLayout
from foldback.planner.errors import SimulationError
from foldback.planner.simulation.engine import SpringChain, build_chain_model, found_contacts
from foldback.planner.simulation.lazy_mujoco import mujoco
from foldback.planner.simulation.mujoco_models import (
    SEGMENT_MODULES,
    Material,
    compiled,
    segment_spec,
    segment_starts,
)
from foldback.planner.simulation.reduced_state import Acceleration, State

BIAS_STEP_S: Final = 1e-4
"""Step, s, of the finite difference for the acceleration of contact points at constant hinge rates
(J Ṡ q̇: contact Jacobian J, map S from hinge rates to body velocities)."""
MIN_FREE_GAP_PITCH: Final = 1e-6
"""Gap between the collision hulls of modules, pitches, from which on a simulation step omits
MuJoCo's contact detection, as nothing touches."""


class Segments(SpringChain):
    """Chain as segments, with their MuJoCo model and its data; the root is the middle module."""

    def __init__(
        self, chain: Chain, material: Material, *, segment_modules: int = SEGMENT_MODULES
    ) -> None:
        starts = segment_starts(chain, segment_modules, root=chain.root)
        self.starts = np.array(starts, dtype=np.int64)
        self.model: Any = compiled(segment_spec(chain, material, starts))
        self._set_options()
        self.data: Any = mujoco.MjData(self.model)
        super().__init__(chain, material, build_chain_model(chain, root=chain.root))
        self._ahead = ModuleStates.empty(len(chain))
        self._bias = np.zeros(self.model.nv)
        self._geom_size = material.geom_size
        joints = [self.model.joint(name) for name in chain.joint_names]
        hinge_qpos = np.array([j.qposadr[0] for j in joints], dtype=np.int64)
        self.hinge_dofs = np.array([j.dofadr[0] for j in joints], dtype=np.int64)
        """(J,) indices of the hinges' velocities in ``qvel``."""
        roots = [self.model.joint(f"root_{start}") for start in starts]
        root_qpos = np.array([j.qposadr[0] for j in roots], dtype=np.int64)
        root_dofs = np.array([j.dofadr[0] for j in roots], dtype=np.int64)
        self._layout = SegmentLayout(self.starts, hinge_qpos, self.hinge_dofs, root_qpos, root_dofs)
        self._middle = starts.index(chain.root)
        self._hinge_ids = np.array([j.id for j in joints], dtype=np.int64)
        self._bodies = np.array([self.model.body(f"module_{i}").id for i in range(len(chain))])
        geoms = np.full(self.model.ngeom, -1, dtype=np.int64)
        of_body = dict(zip(self._bodies.tolist(), range(len(chain)), strict=True))
        for geom, body in enumerate(self.model.geom_bodyid.tolist()):
            geoms[geom] = of_body.get(body, -1)
        self._module_of_geom = geoms

    def _set_options(self) -> None:
        option = self.model.opt
        option.solver = mujoco.mjtSolver.mjSOL_NEWTON
        option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
        option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
        option.iterations = 15
        option.tolerance = 1e-6
        option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_DIAGEXACT)
        self.model.body_invweight0[:] *= 1e-4

    def set_stiffness(self, stiffness: Array) -> None:
        """Set the stiffness of the springs of (J,) hinges."""
        super().set_stiffness(stiffness)
        self.model.jnt_stiffness[self._hinge_ids] = stiffness

    def set_rotor_inertias(self, inertias: Array) -> None:
        """Set the rotor inertias of (J,) hinges, module mass · pitch²."""
        super().set_rotor_inertias(inertias)
        self.model.dof_armature[self.hinge_dofs] = inertias

    def accelerations(self, state: State, forces: Array) -> Acceleration:
        """Return the acceleration of a state under forces on the modules, by MuJoCo.

        ``place`` must have been called for the same state.

        Args:
            state: The reduced state.
            forces: (n, 3) forces at the modules' centres, in the world frame.

        Raises:
            SimulationError: The accelerations are not finite.
        """
        model, data = self.model, self.data
        self._write(state)
        data.xfrc_applied[self._bodies, :3] = forces
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        if data.ncon:
            self._add_bias_to_contacts(state)
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        mujoco.mj_fwdConstraint(model, data)
        acceleration = data.qacc
        if not np.isfinite(acceleration).all() or np.abs(acceleration).max() > 1e10:
            raise SimulationError("the accelerations became infinite or undefined.")
        at = self._layout.root_dofs[self._middle]
        root = acceleration[at : at + 6].copy()
        return Acceleration(
            hinges=acceleration[self.hinge_dofs],
            linear=root[:3],
            angular=root[3:],
            contacts=int(data.ncon),
            depth=max(0.0, -float(data.contact.dist.min())) if data.ncon else 0.0,
        )

    def _write(self, state: State) -> None:
        """Write a state that has been placed into MuJoCo's."""
        write_state(
            state.angles,
            state.rates,
            self.modules,
            self._layout,
            self.data.qpos,
            self.data.qvel,
        )

    def is_free(self, state: State, near: Ints) -> bool:
        """Return True if nothing touches in a placed state and no hinge is at its stop.

        Args:
            state: The reduced state.
            near: (P, 2) pairs of modules that are not linked and near enough to touch.
        """
        module = self.chain.module
        low, high = self.stops.T
        if ((state.angles <= low) | (state.angles >= high)).any():
            return False
        separation, _, _ = least_separation(
            self.positions,
            self.rotations,
            near,
            module.hull,
            self._geom_size,
            MIN_FREE_GAP_PITCH,
        )
        return separation >= MIN_FREE_GAP_PITCH

    def find_placed(self, state: State) -> PairContacts | None:
        """Return the contacts of a placed state, by MuJoCo's collision; None if there are none."""
        data = self.data
        self._write(state)
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_collision(self.model, data)
        return found_contacts(data, self._module_of_geom)

    def _add_bias_to_contacts(self, state: State) -> None:
        data = self.data
        ahead = state.copy()
        ahead.advance(BIAS_STEP_S)
        self._compute_kinematics(ahead, self._ahead)
        # Constant hinge velocities: only those of the roots change.
        bias = self._bias
        bias[:] = data.qvel
        write_root_velocities(self._ahead, self.starts, self._layout.root_dofs, bias)
        bias -= data.qvel
        bias /= BIAS_STEP_S
        rows = np.empty(data.nefc)
        mujoco.mj_mulJacVec(self.model, data, rows, self._bias)
        contact = data.efc_type >= int(mujoco.mjtConstraint.mjCNSTR_CONTACT_FRICTIONLESS)
        data.efc_aref[contact] += rows[contact]
