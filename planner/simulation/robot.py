"""Robot: a chain as it would be built, not as it was drawn, simulated at linear cost.

Its modules are heavier or lighter than the planner thinks, its joints rub, its encoders have steps,
noise and an offset, and its motors give so much torque and no more. Each hinge has a servo of its
own:

    τ = kp (q_next − q_seen) + kv (q̇_next − q̇) + feed-forward,   |τ| ≤ limit

which is taken at the end of the step, as MuJoCo's implicit integrators take it: with stiffness and
damping in the hinges' inertia, h² kp + h kv, it is stable however stiff it is.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.rotations import matrix_from_wxyz, wxyz_from_matrix
from planner.errors import SimulationError
from planner.kernels.module import ReducedAcceleration, ReducedState
from planner.kernels.servo_step import (
    RobotServos,
    ServoTarget,
    advance,
    remove_net_momentum,
    servo_torques,
)
from planner.parameters.playback import RobotParameters
from planner.simulation.model import Material
from planner.simulation.mujoco import mujoco
from planner.simulation.reduced import Acceleration, State
from planner.simulation.segments import Segments

Array = NDArray[np.float64]
STIFFER_WELDS: Final = 1e-6
"""Factor of the welds' regularisation: they are not to give under servos whose inertia, as it is
taken, is a thousand times a module's."""
TOLERANCE: Final = 1e-9
"""Of MuJoCo's solver: from 1e-7 on the welds' errors are seen in the joints."""
MOST_SATURATED: Final = 8
"""Times that a step is worked out to find which motors are at their limit."""
CONTACT_STEPS: Final = 2.0
"""Time constant of contacts in steps, MuJoCo's limit of stability."""


class RobotBody:
    """The model that all robots of one chain are made of.

    Args:
        chain: The chain, as it was drawn.
        geom_size: Size of the colliding modules as a fraction of the pitch.
        step_s: Time step, at which the servos act too.
    """

    def __init__(self, chain: Chain, *, geom_size: float, step_s: float) -> None:
        self.segments = Segments(
            chain, Material(geom_size=geom_size, contact_time_constant=CONTACT_STEPS * step_s)
        )
        model: Any = self.segments.model
        model.opt.timestep = step_s
        model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_DIAGEXACT)
        # All of it hangs together, and the welds' forces follow from this step alone.
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ISLAND)
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_WARMSTART)
        model.opt.tolerance = TOLERANCE
        model.body_invweight0[:] *= STIFFER_WELDS
        names = [model.body(body).name for body in range(1, model.nbody)]
        self._modules = np.array([int(name.rpartition("_")[2]) for name in names])

    def of_masses(self, masses: Array) -> Segments:
        """A body of its own for a robot of (n,) masses, inertias in proportion."""
        segments = self.segments.copy()
        shares = masses[self._modules]
        segments.model.body_mass[1:] *= shares
        segments.model.body_inertia[1:] *= shares[:, None]
        return segments


class Faults:
    """What is not ideal about one robot, drawn from its seed.

    Attributes:
        masses: (n,) of the modules.
        friction: (J,) largest torque of dry friction in each hinge.
        expected_friction: The mean of its kind, which servos reckon with.
        offsets: (J,) of the encoders, in radians.
        encoder_rad: Their steps.
        limit: Largest torque of a motor.
        stiffness, damping: Of the servos.

    Args:
        chain: The chain.
        parameters: What the robot is like.
        peak_torque: Largest torque of the plan, of which limits and friction are multiples.
        seed: Whole numbers that say which robot of this kind it is.
    """

    def __init__(
        self, chain: Chain, parameters: RobotParameters, *, peak_torque: float, seed: list[int]
    ) -> None:
        n, hinges = len(chain), len(chain.folded_rad)
        self._rng = rng = np.random.default_rng(seed)
        self.limit = parameters.torque_limit * peak_torque
        self.stiffness = self.limit / parameters.give_rad
        self.damping = self.stiffness * parameters.damping_s
        self.masses = 1.0 + parameters.mass_error * rng.standard_normal(n)
        self.expected_friction = parameters.friction * peak_torque
        self.friction = self.expected_friction * rng.uniform(0.5, 1.5, hinges)
        self.encoder_rad = parameters.encoder_rad
        self.offsets = self.encoder_rad * rng.uniform(-0.5, 0.5, hinges)
        self._noise_rad = parameters.noise_rad

    def drive(
        self,
        hinges: slice,
        angles: Array,
        rates: Array,
        target: tuple[Array, Array, Array],
        step_s: float,
        accelerations: Callable[[Array, Array], Array],
    ) -> Array:
        """(H,) torques that motors give in a step, found anew while some are beyond their limit.

        Args:
            hinges: Which of the chain's they are.
            angles, rates: (H,) as they are.
            target: (H,) angles and rates at the step's end, and torques that a robot without faults
                needs for it.
            step_s: Time step.
            accelerations: Gives the (H,) accelerations of the hinges under (H,) rotor inertias and
                torques. Called last with those of the step.
        """
        count = len(angles)
        wanted, rubbing = np.empty(count), np.empty(count)
        servos = RobotServos(
            self.offsets[hinges],
            self.friction[hinges],
            self.encoder_rad,
            self.stiffness,
            self.damping,
            self.expected_friction,
        )
        noise = self._noise_rad * self._rng.standard_normal(count)
        servo_torques(angles, rates, ServoTarget(*target), noise, servos, step_s, wanted, rubbing)
        inertia = step_s * step_s * self.stiffness + step_s * self.damping
        limited = np.zeros(count)
        left = MOST_SATURATED
        while True:
            free, left = limited == 0.0, left - 1
            motors = np.where(free, wanted, self.limit * limited)
            found = accelerations(
                np.where(free, inertia, 0.0) + step_s * rubbing, motors - rubbing * rates
            )
            given = np.where(free, wanted - inertia * found, motors)
            beyond = free & (np.abs(given) > self.limit)
            if not left or not beyond.any():
                return given
            limited[beyond] = np.sign(given[beyond])


class Robot:
    """A chain with servos and the faults of one robot.

    Args:
        body: What it is made of.
        parameters: What the robot is like.
        peak_torque: Largest torque of the plan, of which limits and friction are multiples.
        seed: Whole numbers that say which robot of this kind it is.
    """

    def __init__(
        self,
        body: RobotBody,
        parameters: RobotParameters,
        *,
        peak_torque: float,
        seed: list[int],
    ) -> None:
        self.chain = chain = body.segments.chain
        self._step_s = float(body.segments.model.opt.timestep)
        self.faults = Faults(chain, parameters, peak_torque=peak_torque, seed=seed)
        hinges = len(chain.folded_rad)
        self._segments = body.of_masses(self.faults.masses)
        self._target = (np.zeros(hinges), np.zeros(hinges), np.zeros(hinges))
        self.torques = np.zeros(hinges)
        """(J,) of the motors in the last step."""
        self.state = State.at_rest(np.zeros(hinges), np.zeros(3), np.eye(3))
        self._centre = np.zeros(3)

    @property
    def angles(self) -> Array:
        """(J,) a copy of the hinge angles."""
        return self.state.angles.copy()

    @property
    def rates(self) -> Array:
        """(J,) a copy of the hinge velocities."""
        return self.state.rates.copy()

    @property
    def centres(self) -> Array:
        """(n, 3) a copy of the modules' centres, from their mean."""
        centres = self._segments.positions
        return centres - centres.mean(axis=0)

    @property
    def root_position(self) -> Array:
        """(3,) a copy of the root's centre."""
        return self.state.position.copy()

    @property
    def root_wxyz(self) -> Array:
        """(4,) the root's orientation."""
        return wxyz_from_matrix(self.state.rotation)

    @property
    def motor_torques(self) -> Array:
        """(J,) what the motors did in the last step."""
        return self.torques

    def place(self, angles: Array, root_position: Array, root_wxyz: Array) -> None:
        """Sets a configuration at rest."""
        self.state = State.at_rest(angles, root_position, matrix_from_wxyz(root_wxyz))
        self._segments.place(self.state)
        self._centre = self.faults.masses @ self._segments.positions / self.faults.masses.sum()

    def begin_step(self) -> None:
        """Nothing: poses are those of the present state at any time."""

    def follow(self, angles: Array, rates: Array, torques: Array) -> None:
        """Tells the servos where hinges are to be after the coming step, how fast, and with what.

        Args:
            angles, rates: (J,) at the step's end.
            torques: (J,) that a robot without faults needs for it.
        """
        self._target = (angles, rates, torques)

    def end_step(self) -> None:
        """One step.

        Raises:
            SimulationError: When the numbers are bad.
        """
        state, h, segments = self.state, self._step_s, self._segments
        model, data, dofs = segments.model, segments.data, segments.hinge_dofs
        found: list[Acceleration] = []

        def accelerations(inertia: Array, applied: Array) -> Array:
            model.dof_armature[dofs], data.qfrc_applied[dofs] = inertia, applied
            found.append(segments.accelerations(state, None))
            return found[-1].hinges

        hinges = slice(0, len(state.angles))
        given = self.faults.drive(hinges, state.angles, state.rates, self._target, h, accelerations)
        acceleration = found[-1]
        self.torques = given
        if not advance(
            self._reduced,
            ReducedAcceleration(acceleration.hinges, acceleration.linear, acceleration.angular),
            h,
            self.chain.module.joint,
            segments.root,
            segments.modules,
        ):
            raise SimulationError("the state is no longer finite.")

    def stop_drifting(self) -> None:
        """Takes away the momentum that integration has added since the chain was at rest."""
        remove_net_momentum(
            self.faults.masses,
            self.chain.module.inertia,
            self._segments.root,
            self._centre,
            self._reduced,
            self._segments.modules,
        )

    @property
    def _reduced(self) -> ReducedState:
        """The state's arrays, as kernels take them."""
        s = self.state
        return ReducedState(s.angles, s.rates, s.position, s.rotation, s.velocity, s.spin)
