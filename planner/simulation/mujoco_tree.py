"""MuJoCo tree: a chain as one tree, rooted in the middle, for playbacks without robots."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.errors import SimulationError
from foldback.planner.simulation.lazy_mujoco import mujoco
from foldback.planner.simulation.mujoco_models import (
    STIFF_SOLREF_SOLIMP,
    Material,
    compiled,
    tree_spec,
)

ROOT_DOFS: Final = 6
"""Number of degrees of freedom of the root of a simulated chain that floats freely: 3 translations
and 3 rotations, the first 6 entries of MuJoCo's velocities."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Servos:
    """Position actuators: kp (target − angle) − kv rate.

    Attributes:
        stiffness: kp, torque per rad.
        damping: kv, torque per rad/s.
        torque_limit: Largest torque; None for no limit.
    """

    stiffness: float
    damping: float
    torque_limit: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RateMotors:
    """Motors as constraints: a hinge turns at the wanted rate as long as its torque suffices.

    They work as those of ODE. In MuJoCo each is a row of dry friction, whose bound is the torque,
    with the wanted rate in place of zero.

    Attributes:
        torque_limit: Largest torque.
    """

    torque_limit: float


class Indices(NamedTuple):
    """Indices of hinges (J,) and modules (n,) in MuJoCo's arrays."""

    qpos: Ints
    dofs: Ints
    joints: Ints
    bodies: Ints

    @classmethod
    def of(cls, model: Any, chain: Chain) -> Indices:
        """Return the indices of a chain in a model."""
        joints = [model.joint(name) for name in chain.joint_names]
        bodies = [model.body(f"module_{i}").id for i in range(len(chain))]
        return cls(
            qpos=np.array([j.qposadr[0] for j in joints], dtype=np.int64),
            dofs=np.array([j.dofadr[0] for j in joints], dtype=np.int64),
            joints=np.array([j.id for j in joints], dtype=np.int64),
            bodies=np.array(bodies, dtype=np.int64),
        )


class Tree:
    """Chain as one MuJoCo tree, with its model and data.

    Args:
        chain: The chain.
        material: Material of its joints and surfaces.
        step_s: Time step, s.
        motors: Motors of every hinge; None for a chain without.
        damping: Fraction of its velocity that the chain loses in each step, by the generalised
            force −(damping / step) M q̇, which does not depend on the coordinates.
        masses: (n,) masses of the modules; those of their pieces by default.
    """

    def __init__(
        self,
        chain: Chain,
        material: Material,
        *,
        step_s: float,
        motors: Servos | RateMotors | None = None,
        damping: float = 0.0,
        masses: Array | None = None,
    ) -> None:
        self.chain = chain
        self.motors = motors
        self._drag = damping / step_s
        spec = tree_spec(chain, material, masses=masses)
        if isinstance(motors, Servos):
            _add_servos(spec, chain, motors)
        elif isinstance(motors, RateMotors):
            _add_rate_motors(spec, chain, motors)
        self.model: Any = compiled(spec)
        self.model.opt.timestep = step_s
        self.model.opt.integrator = (
            mujoco.mjtIntegrator.mjINT_IMPLICITFAST
            if isinstance(motors, Servos)
            else mujoco.mjtIntegrator.mjINT_EULER
        )
        self.data: Any = mujoco.MjData(self.model)
        self.indices = Indices.of(self.model, chain)
        """Indices of hinges and modules in MuJoCo's arrays."""
        self._work = np.empty(self.model.nv)
        self._passive = np.zeros(self.model.nv)
        if isinstance(motors, Servos):
            self._actuators = np.array([self.model.actuator(n).id for n in chain.joint_names])
        self._hinge_of_dof = np.zeros(self.model.nv, dtype=np.int64)
        self._hinge_of_dof[self.indices.dofs] = np.arange(len(self.indices.dofs))
        self._rows = self._hinge_of_row = np.zeros(0, dtype=np.int64)
        self._centre = np.zeros(3)
        rows, columns = np.indices((ROOT_DOFS, ROOT_DOFS))  # M holds the lower triangle by rows
        starts = self.model.M_rowadr[np.maximum(rows, columns)]
        self._root_block = (starts + np.minimum(rows, columns)).astype(np.int64)

    @property
    def angles(self) -> Array:
        """(J,) a copy of the hinge angles, rad."""
        return self.data.qpos[self.indices.qpos]

    @property
    def rates(self) -> Array:
        """(J,) a copy of the hinge velocities, rad/s."""
        return self.data.qvel[self.indices.dofs]

    @property
    def centres(self) -> Array:
        """(n, 3) centres of the modules at ``begin_step`` relative to their mean, pitches."""
        centres = self.data.xpos[self.indices.bodies]
        return centres - centres.mean(axis=0)

    @property
    def root_position(self) -> Array:
        """(3,) a copy of the root's centre, pitches."""
        return self.data.qpos[:3].copy()

    @property
    def root_wxyz(self) -> Array:
        """(4,) a copy of the root's orientation, w first."""
        return self.data.qpos[3:7].copy()

    @property
    def motor_torques(self) -> Array:
        """(J,) torques of motors and applied torques in the last step."""
        data = self.data
        torques = (data.qfrc_actuator + data.qfrc_applied - self._passive)[self.indices.dofs]
        if isinstance(self.motors, RateMotors):
            torques[self._hinge_of_row] += data.efc_force[self._rows]
        return torques

    def place(self, angles: Array, root_position: Array, root_wxyz: Array) -> None:
        """Set a configuration at rest."""
        self.data.qpos[:3] = root_position
        self.data.qpos[3:7] = root_wxyz
        self.data.qpos[self.indices.qpos] = angles
        self.data.qvel[:] = 0.0
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        self._centre = self.data.subtree_com[0].copy()

    def begin_step(self) -> None:
        """Compute the part of a step that depends on positions and velocities."""
        data = self.data
        mujoco.mj_step1(self.model, data)
        if self._drag:
            mujoco.mj_mulM(self.model, data, self._passive, data.qvel)
            self._passive *= -self._drag
            data.qfrc_applied[:] = self._passive

    def end_step(self) -> None:
        """Finish a step.

        Raises:
            SimulationError: MuJoCo warns of bad numbers.
        """
        mujoco.mj_step2(self.model, self.data)
        warnings = self.data.warning
        for kind in (
            mujoco.mjtWarning.mjWARN_BADQPOS,
            mujoco.mjtWarning.mjWARN_BADQVEL,
            mujoco.mjtWarning.mjWARN_BADQACC,
        ):
            if warnings[int(kind)].number:
                raise SimulationError("the simulated state became infinite or undefined.")

    def stop_drifting(self) -> None:
        """Remove the momentum that integration has added since the chain was at rest.

        A free chain that began at rest has none: its root's velocity is −M_rr⁻¹ M_rj q̇, and its
        centre of mass stays. A remaining angular momentum about its length would make a chain spin
        ever faster as it becomes straight.
        """
        data = self.data
        data.qpos[:3] += self._centre - data.subtree_com[0]  # as of ``begin_step``
        self._remove_momentum()

    def _remove_momentum(self) -> None:
        """Give the root the velocity of a chain without momentum, −M_rr⁻¹ M_rj q̇."""
        data = self.data
        mujoco.mj_mulM(self.model, data, self._work, data.qvel)
        data.qvel[:ROOT_DOFS] -= np.linalg.solve(self._root_inertia(), self._work[:ROOT_DOFS])

    def apply_torques(self, torques: Array) -> None:
        """Set (J,) torques on the hinges for the coming step."""
        self.data.qfrc_applied[self.indices.dofs] = self._passive[self.indices.dofs] + torques

    def set_rates(self, rates: Array) -> None:
        """Set (J,) rates of rate motors for the coming step, after ``begin_step``."""
        data = self.data
        rows = np.flatnonzero(data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF))
        self._rows, self._hinge_of_row = rows, self._hinge_of_dof[data.efc_id[rows]]
        # A row's reference acceleration is −b (J q̇): that of a rate w is −b (J q̇ − w).
        data.efc_aref[rows] += data.efc_KBIP[rows, 1] * rates[self._hinge_of_row]

    def set_servo_targets(self, targets: Array) -> None:
        """Set (J,) target angles of the position actuators for the coming step."""
        self.data.ctrl[self._actuators] = targets

    def torques_for(self, accelerations: Array) -> Array:
        """Return (J,) torques that cause given hinge accelerations of a floating chain.

        The root's acceleration is the one that needs no force on it:
        a_root = −M_rr⁻¹ r, with r the root's residual of the inverse dynamics for a_root = 0.
        ``begin_step`` or ``evaluate`` must have been called for the state.
        """
        data, model = self.data, self.model
        accelerations_before = data.qacc.copy()
        data.qacc[:ROOT_DOFS] = 0.0
        data.qacc[self.indices.dofs] = accelerations
        mujoco.mj_rne(model, data, 1, self._work)
        data.qacc[:ROOT_DOFS] = -np.linalg.solve(self._root_inertia(), self._work[:ROOT_DOFS])
        mujoco.mj_rne(model, data, 1, self._work)
        data.qacc[:] = accelerations_before
        return self._work[self.indices.dofs]

    def evaluate(self, angles: Array, rates: Array) -> None:
        """Compute positions and velocities of a free chain without momentum.

        The root stands at the origin; its velocity is −M_rr⁻¹ M_rj q̇.
        """
        data, model = self.data, self.model
        data.qpos[:7] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        data.qpos[self.indices.qpos] = angles
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeM(model, data)
        data.qvel[:] = 0.0
        data.qvel[self.indices.dofs] = rates
        mujoco.mj_mulM(model, data, self._work, data.qvel)
        data.qvel[:ROOT_DOFS] = -np.linalg.solve(self._root_inertia(), self._work[:ROOT_DOFS])
        mujoco.mj_comVel(model, data)

    def held_torques(self, angles: Array, rates: Array, accelerations: Array) -> Array:
        """Return (J,) torques of a motion while the root is held still, without gravity."""
        data, model = self.data, self.model
        data.qpos[:7] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        data.qpos[self.indices.qpos] = angles
        for values, source in ((data.qvel, rates), (data.qacc, accelerations)):
            values[:] = 0.0
            values[self.indices.dofs] = source
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 1, self._work)
        return self._work[self.indices.dofs]

    def gravity_torques(self) -> Array:
        """Return (J,) torques under gravity 1 in each hinge's worst direction, the root held.

        A hinge with axis a carries the modules beyond it, of mass m and with their centre at r from
        it: m |a × r|. The configuration is that of the last ``evaluate``.
        """
        data, model = self.data, self.model
        bodies = model.jnt_bodyid[self.indices.joints]
        arms = data.subtree_com[bodies] - data.xanchor[self.indices.joints]
        lengths = np.linalg.norm(np.cross(data.xaxis[self.indices.joints], arms), axis=1)
        return model.body_subtreemass[bodies] * lengths

    def _root_inertia(self) -> Array:
        """Return the root's (6, 6) block of the mass matrix: the whole chain as one rigid body."""
        return self.data.M[self._root_block]


def _add_servos(spec: Any, chain: Chain, servos: Servos) -> None:
    limit = servos.torque_limit
    for name in chain.joint_names:
        motor = spec.add_actuator()
        motor.name = name
        motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
        motor.target = name
        motor.gaintype = mujoco.mjtGain.mjGAIN_FIXED
        motor.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        motor.gainprm[0] = servos.stiffness
        motor.biasprm[:3] = [0.0, -servos.stiffness, -servos.damping]
        if limit is not None:
            motor.forcelimited = True
            motor.forcerange = [-limit, limit]


def _add_rate_motors(spec: Any, chain: Chain, motors: RateMotors) -> None:
    for name in chain.joint_names:
        hinge = spec.joint(name)
        hinge.frictionloss = motors.torque_limit
        hinge.solref_friction, hinge.solimp_friction = STIFF_SOLREF_SOLIMP
