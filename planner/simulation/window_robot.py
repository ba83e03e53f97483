"""Window robot: a robot with faults that folds a long chain, its core and its rod rigid.

As ``planner.simulation.robot``, with the joints of one stretch alone. Hinges that join the core are
latched there at their folded angles; those of the rod are latched straight.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.errors import SimulationError
from planner.parameters.playback import RobotParameters
from planner.simulation.mujoco import mujoco
from planner.simulation.robot import Faults
from planner.simulation.window_body import Lumps, WindowBody

Array = NDArray[np.float64]


class WindowRobot:
    """A chain with servos and the faults of one robot, of which a stretch of joints moves.

    Args:
        chain: The chain.
        parameters: What the robot is like.
        peak_torque: Largest torque of the plan, of which limits and friction are multiples.
        seed: Whole numbers that say which robot of this kind it is.
        base: Centre and orientation of module 0, at rest.
    """

    def __init__(
        self,
        chain: Chain,
        parameters: RobotParameters,
        *,
        peak_torque: float,
        seed: list[int],
        base: tuple[Array, Array],
    ) -> None:
        self.chain = chain
        self.faults = Faults(chain, parameters, peak_torque=peak_torque, seed=seed)
        self._lumps = Lumps(chain, self.faults.masses)
        self._base = base
        self._first = 0
        self._rates = np.zeros(0)
        self._bodies: dict[int, WindowBody] = {}
        self._body: WindowBody | None = None
        self._centre: Array | None = None
        self.angles = np.zeros(0)
        """(H,) of the stretch."""

    def take(self, first: int, body: WindowBody) -> None:
        """Goes on with another stretch.

        Args:
            first: Its first joint, see ``WindowBody.take``.
            body: Of as many joints; it is not changed.
        """
        base = self.base_pose
        if body.joints not in self._bodies:
            self._bodies[body.joints] = body.copy()
        self._body = body = self._bodies[body.joints]
        body.take(first, self._lumps)
        k = self.chain.module.hinges_per_joint
        start, stop = k * first, k * (first + body.joints)
        known = slice(k * self._first, k * self._first + len(self.angles))
        angles, rates = np.zeros(stop - start), np.zeros(stop - start)
        folded = max(start, min(known.start, stop))
        angles[: folded - start] = self.chain.folded_rad[start:folded]
        low, high = max(start, known.start), min(stop, known.stop)
        if high > low:
            angles[low - start : high - start] = self.angles[low - known.start : high - known.start]
            rates[low - start : high - start] = self._rates[low - known.start : high - known.start]
        self.angles, self._rates, self._first = angles, rates, first
        self._hinges = slice(start, stop)
        body.place(base, angles)
        body.move(rates)

    @property
    def base_pose(self) -> tuple[Array, Array]:
        """(3,) centre of module 0 and (4,) its orientation."""
        return self._base if self._body is None else self._body.core_pose()

    def step(self, angles: Array, rates: Array, torques: Array) -> Array:
        """One step towards (H,) angles and rates at its end; (H,) torques of the motors.

        Args:
            angles, rates: (H,) at the step's end.
            torques: (H,) that a robot without faults needs for it.

        Raises:
            SimulationError: When the numbers are bad.
        """
        body = self._body
        assert body is not None
        model, data, dofs = body.model, body.data, body.dofs

        def accelerations(inertia: Array, applied: Array) -> Array:
            model.dof_armature[dofs], data.qfrc_applied[dofs] = inertia, applied
            mujoco.mj_forward(model, data)
            return data.qacc[dofs]

        given = self.faults.drive(
            self._hinges,
            self.angles,
            self._rates,
            (angles, rates, torques),
            float(model.opt.timestep),
            accelerations,
        )
        centre = body.take_momentum()  # what integration has added to it
        if self._centre is None:
            self._centre = centre
        mujoco.mj_Euler(model, data)
        data.qpos[:3] += self._centre - centre
        if not np.isfinite(data.qpos).all():
            raise SimulationError("the state is no longer finite.")
        self.angles, self._rates = data.qpos[dofs + 1], data.qvel[dofs]
        return given
