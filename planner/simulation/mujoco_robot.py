"""MuJoCo robot: a robot with model errors that MuJoCo itself simulates.

The chain is one tree. Its servos are position actuators, their torque limit is the range of the
actuator force of a joint, and masses are those of the bodies. Integrator (``implicitfast``), solver
and collision are MuJoCo's. Encoders, and the law of dry friction, act on the actuators' targets and
on the joints' damping, which are set anew in each step: docs/decisions/0058-a-robot-by-mujoco.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.rotations import matrix_from_wxyz
from foldback.planner.core.structures import RobotStates
from foldback.planner.errors import SimulationError
from foldback.planner.simulation.lazy_mujoco import mujoco
from foldback.planner.simulation.mujoco_models import Material
from foldback.planner.simulation.mujoco_tree import Servos, Tree
from foldback.planner.simulation.robot import FollowedSteps, RobotErrors

FRICTION_SPEED_RAD_S: Final = 2e-3
"""Joint speed v₀, rad/s, in the law of dry friction, torque ∝ tanh(speed / v₀): that of all
robots."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Substeps:
    """Targets of m equal parts of one step.

    Attributes:
        step_s: Time step of a part, s.
        angles: (m, J) hinge angles at the beginning of each part, rad.
        rates: (m, J) their rates in each part, rad/s.
        torques: (m, J) torques that a robot without model errors needs in each.
    """

    step_s: float
    angles: Array
    rates: Array
    torques: Array

    @classmethod
    def still(cls, angles: Array, step_s: float) -> Substeps:
        """Return one part in which (J,) angles are held."""
        zero = np.zeros((1, len(angles)))
        return cls(step_s=step_s, angles=angles[None], rates=zero, torques=zero)


class MujocoRobot(Tree):
    """Robot of which MuJoCo simulates all hinges.

    Args:
        chain: The chain.
        errors: Model errors of the robot.
        geom_size: Size of the colliding modules as a fraction of the pitch.
        step_s: Time step, s.
    """

    def __init__(
        self, chain: Chain, errors: RobotErrors, *, geom_size: float, step_s: float
    ) -> None:
        contact_time_constant = 2.0 * step_s  # the hardest contacts that MuJoCo permits
        super().__init__(
            chain,
            Material(geom_size=geom_size, contact_time_constant=contact_time_constant),
            step_s=step_s,
            motors=Servos(stiffness=errors.stiffness, damping=errors.damping),
            masses=errors.masses,
        )
        self.errors = errors
        model, at = self.model, self.indices
        # Where a force meets the range of its actuator, MuJoCo's integrator leaves out the damping
        # of that actuator, and a hinge with a stiff servo diverges. The range of a joint's
        # actuator force limits the same torque and keeps the damping.
        model.jnt_actfrclimited[at.joints] = True
        model.jnt_actfrcrange[at.joints] = (-errors.limit, errors.limit)

    def follow(self, steps: Sequence[Substeps]) -> FollowedSteps:
        """Make S steps, each in as many steps of MuJoCo as it has parts."""
        states = RobotStates.empty(1, len(steps), len(self.indices.dofs))
        self._write_state(states, 0)
        followed = FollowedSteps(states=states, made=np.zeros(1, np.int64), broken={})
        try:
            for k, parts in enumerate(steps):
                self.model.opt.timestep = parts.step_s
                for target in zip(parts.angles, parts.rates, parts.torques, strict=True):
                    states.torques[0, k] = self._step(*target)
                self.stop_drifting()
                self._write_state(states, k + 1)
                followed.made[0] += 1
        except SimulationError as error:
            followed.broken[0] = error
        return followed

    def _write_state(self, states: RobotStates, row: int) -> None:
        states.q[0, row], states.qd[0, row] = self.angles, self.rates
        states.position[0, row] = self.data.qpos[:3]
        states.rotation[0, row] = matrix_from_wxyz(self.data.qpos[3:7])

    def _step(self, angles: Array, rates: Array, torques: Array) -> Array:
        """Make one step of MuJoCo, and return the motors' torques, their damping at its end.

        Args:
            angles: (J,) targets at the beginning of the step, where MuJoCo evaluates kp, rad.
            rates: (J,) targets at its end, where MuJoCo evaluates kv, rad/s.
            torques: (J,) torques that a robot without model errors needs.
        """
        errors, present, present_rates = self.errors, self.angles, self.rates
        compensation = errors.expected_friction * np.tanh(rates / FRICTION_SPEED_RAD_S)
        # MuJoCo's force is kp (ctrl − q) − kv q̇: all other terms of a servo are in its target.
        others = errors.damping * rates + torques + compensation
        if errors.stiffness > 0.0:  # a chain that folds into a line needs no torque
            others /= errors.stiffness
        self.set_servo_targets(angles + (present - errors.measure(present)) + others)
        speeds = np.maximum(np.abs(present_rates), np.abs(rates))
        self.model.dof_damping[self.indices.dofs] = (
            errors.friction * np.tanh(speeds / FRICTION_SPEED_RAD_S) / np.maximum(speeds, 1e-12)
        )
        self._integrate()
        if not np.isfinite(self.data.qpos).all():
            raise SimulationError("the simulated state became infinite or undefined.")
        forces = self.data.qfrc_actuator[self.indices.dofs]
        return forces - errors.damping * (self.rates - present_rates)

    def _integrate(self) -> None:
        """Make one step of MuJoCo, without the momentum that the last one has added.

        Where no hinge is at its stop and nothing touches, there are no constraints. Then the
        integrator alone factorises a matrix, M + h kv: that of M, half of a step's time, would
        only serve the solver. So parts of ``mj_step`` that have no effect are left out.
        """
        model, data = self.model, self.data
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeM(model, data)
        mujoco.mj_collision(model, data)
        mujoco.mj_makeConstraint(model, data)
        if data.nefc:
            mujoco.mj_fwdPosition(model, data)
        else:
            mujoco.mj_transmission(model, data)
        self._remove_momentum()
        mujoco.mj_fwdVelocity(model, data)
        if data.nefc:
            super().end_step()
            return
        mujoco.mj_fwdActuation(model, data)
        data.qfrc_smooth[:] = data.qfrc_passive - data.qfrc_bias + data.qfrc_actuator
        data.qfrc_constraint[:] = 0.0
        mujoco.mj_implicit(model, data)

    def stop_drifting(self) -> None:
        """Hold the centre of mass, which a chain that began at rest cannot move."""
        self.data.qpos[:3] += self._centre - self.data.subtree_com[0]  # as of the step's beginning
