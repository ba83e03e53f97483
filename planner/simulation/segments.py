"""Segments: accelerations of a chain at linear cost, with exact re-synchronisation.

MuJoCo sees free trees of a few modules, welded end to end. Only the *reduced* state is integrated:
all hinge angles and the pose of one root. Before every evaluation exact forward kinematics writes
the pose and velocity of every segment, so the welds are closed at every step and nothing drifts;
contacts act on the very poses that are recorded.

In reduced coordinates a contact row asks J S q̈ = a_ref; MuJoCo's rows see J (S q̈ + Ṡ q̇) instead,
where S maps reduced to segment velocities. So J Ṡ q̇ is added to the reference of contact rows. Weld
rows keep theirs: MuJoCo's own −J̇ q̇ is what keeps the ends together.

Of a chain without a base MuJoCo only finds the contacts: their forces come of a system of their
own, in which the chain answers as one tree (``planner.kernels.articulated``).
"""

from __future__ import annotations

from copy import copy
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.errors import SimulationError
from planner.kernels.clearance import least_separation
from planner.kernels.module import ModuleStates
from planner.kernels.segment_state import SegmentLayout, write_root_velocities, write_state
from planner.simulation.engine import DetectedContacts, SpringChain, build_chain_model
from planner.simulation.model import (
    SEGMENT_MODULES,
    Material,
    compiled,
    segment_spec,
    segment_starts,
)
from planner.simulation.mujoco import mujoco
from planner.simulation.reduced import Acceleration, State

Array = NDArray[np.float64]
BIAS_STEP_S: Final = 1e-4
"""Time step of the finite difference that gives the accelerations of contacts at rest rates."""
FREE_ABOVE: Final = 1e-6
"""Distance in pitches from which on two hulls are not in contact."""
WELD_STIFFENING: Final = 1e-4
"""Factor of the bodies' inverse weights in MuJoCo's regularisation of weld rows."""


class Segments(SpringChain):
    """A chain as MuJoCo's segments. Holds a model and its data; the root is the middle module."""

    def __init__(
        self, chain: Chain, material: Material, *, segment_modules: int = SEGMENT_MODULES
    ) -> None:
        starts = segment_starts(chain, segment_modules, root=chain.root)
        self.starts = np.array(starts, dtype=np.int64)
        self.model: Any = compiled(segment_spec(chain, material, starts))
        self._set_options()
        self.data: Any = mujoco.MjData(self.model)
        super().__init__(chain, material, build_chain_model(chain, root=chain.root))
        self._geom_size = material.geom_size
        joints = [self.model.joint(name) for name in chain.joint_names]
        hinge_qpos = np.array([j.qposadr[0] for j in joints], dtype=np.int64)
        self.hinge_dofs = np.array([j.dofadr[0] for j in joints], dtype=np.int64)
        """(J,) where the hinges' velocities are among the model's."""
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

    def copy(self) -> Segments:
        """Segments of the same chain that share nothing that changes with these."""
        twin = copy(self)
        twin.model = copy(self.model)
        twin.data = mujoco.MjData(twin.model)
        twin._make_buffers()
        return twin

    def _make_buffers(self) -> None:
        super()._make_buffers()
        self._ahead = ModuleStates.empty(len(self.positions))
        self._bias = np.zeros(self.model.nv)

    def _set_options(self) -> None:
        option = self.model.opt
        option.solver = mujoco.mjtSolver.mjSOL_NEWTON
        option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
        option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
        option.iterations = 15
        option.tolerance = 1e-6
        option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_DIAGEXACT)
        self.model.body_invweight0[:] *= WELD_STIFFENING

    def set_contact_time_constant(self, seconds: float) -> None:
        """How fast contacts push back: ``solref[0]`` of every geom."""
        self.model.geom_solref[:, 0] = seconds

    def set_stiffness(self, stiffness: Array) -> None:
        """Springs of the (J,) hinges towards straight."""
        super().set_stiffness(stiffness)
        self.model.jnt_stiffness[self._hinge_ids] = stiffness

    def accelerations(self, state: State, forces: Array | None) -> Acceleration:
        """The acceleration of a state under forces on the modules.

        ``place`` must have been called for the same state.

        Args:
            state: The reduced state.
            forces: (n, 3) at the modules' centres, in the world; None for none at any time.

        Raises:
            SimulationError: When MuJoCo warns of bad numbers.
        """
        model, data = self.model, self.data
        self._write(state)
        if forces is not None:
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
            raise SimulationError("the accelerations are no longer finite.")
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
        """Tells MuJoCo a state that has been placed."""
        write_state(
            state.angles,
            state.rates,
            self.modules,
            self._layout,
            self.data.qpos,
            self.data.qvel,
        )

    def is_free(self, state: State, near: NDArray[np.int64]) -> bool:
        """Whether nothing touches in a state that has been placed, and no hinge is at its stop.

        Args:
            state: The reduced state.
            near: (P, 2) all pairs of modules that are not linked and so near that they may touch.
        """
        module = self.chain.module
        if np.abs(state.angles).max() >= self.stop_rad:
            return False
        least, _, _ = least_separation(
            self.positions,
            self.rotations,
            near,
            module.hull,
            self._geom_size,
            FREE_ABOVE,
        )
        return least >= FREE_ABOVE

    def lean_accelerations(
        self, state: State, forces: Array, near: NDArray[np.int64]
    ) -> Acceleration:
        """``accelerations`` in a tenth of the time.

        MuJoCo finds the contacts, and their forces follow its equations; the chain's answer to them
        is that of one tree, without welds. ``place`` must have been called for the same state.

        Args:
            state: The reduced state.
            forces: (n, 3) at the modules' centres, in the world.
            near: (P, 2) all pairs of modules that are not linked and so near that they may touch.

        Raises:
            SimulationError: When the numbers are bad.
        """
        if self.is_free(state, near):
            return self.free_accelerations(state, forces)
        data = self.data
        self._write(state)
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_collision(self.model, data)
        contacts = DetectedContacts.from_mujoco(self.model, data, self._module_of_geom)
        return self._contact_accelerations(state, forces, contacts)

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
