"""Robot: a chain as it is built, with model errors, motors of limited torque and a servo per hinge.

Modules are heavier or lighter than the planner assumes, joints have dry friction, and encoders have
a resolution, noise and an offset. The servo of a hinge gives

    τ = kp (q* − q_measured) + kv (q̇* − q̇) + τ_feedforward,   |τ| ≤ limit,

evaluated at the end of the step, as MuJoCo's implicit integrators do: its stiffness and damping act
as a rotor inertia h² kp + h kv of the hinge, and it is stable for any stiffness.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.rotations import matrix_from_wxyz, wxyz_from_matrix
from foldback.planner.core import advance, remove_net_momentum, servo_torques
from foldback.planner.core.structures import (
    Accelerations,
    Loads,
    ReducedState,
    RobotServos,
    ServoTarget,
)
from foldback.planner.errors import SimulationError
from foldback.planner.parameters.playback import RobotParameters
from foldback.planner.simulation.contact_finder import ContactFinder
from foldback.planner.simulation.engine import DetectedContacts, Engine, build_chain_model
from foldback.planner.simulation.reduced_state import State


class RobotErrors:
    """Model errors and servos of one robot, drawn from its seed.

    Attributes:
        masses: (n,) masses of the modules, in module masses.
        friction: (J,) largest torques of dry friction, module mass · pitch² / s².
        expected_friction: Mean of these over all robots, which servos compensate.
        offsets: (J,) offsets of the encoders, rad.
        encoder_rad: Resolution of the encoders, rad.
        limit: Largest torque of a motor, module mass · pitch² / s².
        stiffness, damping: kp and kv of the servos.

    Args:
        chain: The chain.
        parameters: Kind of robot.
        peak_torque: Largest torque of the plan, which limit and friction are relative to.
        seed: Whole numbers that identify the robot among those of its kind.
    """

    def __init__(
        self, chain: Chain, parameters: RobotParameters, *, peak_torque: float, seed: list[int]
    ) -> None:
        n, hinges = len(chain), len(chain.folded_rad)
        self._rng = rng = np.random.default_rng(seed)
        self.limit = parameters.motor_limit * peak_torque
        self.stiffness = self.limit / parameters.servo_give
        self.damping = self.stiffness * parameters.damping_s
        self.masses = 1.0 + parameters.mass_error * rng.standard_normal(n)
        self.expected_friction = parameters.joint_friction * peak_torque
        self.friction = self.expected_friction * rng.uniform(0.5, 1.5, hinges)
        self.encoder_rad = parameters.encoder_step
        self.offsets = self.encoder_rad * rng.uniform(-0.5, 0.5, hinges)
        self._noise_rad = parameters.encoder_noise

    def measure(self, angles: Array) -> Array:
        """Return what the encoders read of (J,) hinge angles, rad, less their offsets."""
        noisy = angles + self._noise_rad * self._rng.standard_normal(len(angles))
        if self.encoder_rad == 0.0:
            return noisy
        return np.rint((noisy + self.offsets) / self.encoder_rad) * self.encoder_rad - self.offsets

    def drive(
        self,
        hinges: slice,
        state: State,
        target: ServoTarget,
        step_s: float,
        accelerate: Callable[[Array, Array], Accelerations],
    ) -> tuple[Array, Accelerations]:
        """Return (H,) motor torques in a step, and the accelerations under them.

        The step is computed anew while motors are beyond their limit; they then give the limit.

        Args:
            hinges: Slice of the state's hinges in the chain.
            state: Present state.
            target: Setpoint for the end of the step.
            step_s: Time step, s.
            accelerate: Returns accelerations under (H,) rotor inertias and torques.
        """
        count = len(state.angles)
        commanded, friction_damping = np.empty(count), np.empty(count)
        servos = RobotServos(
            self.offsets[hinges],
            self.friction[hinges],
            self.encoder_rad,
            self.stiffness,
            self.damping,
            self.expected_friction,
        )
        noise = self._noise_rad * self._rng.standard_normal(count)
        servo_torques(
            state.angles, state.rates, target, noise, servos, step_s, commanded, friction_damping
        )
        rotor_inertia = step_s * step_s * self.stiffness + step_s * self.damping
        friction = -friction_damping * state.rates
        saturated = np.zeros(count)
        remaining = 8
        while True:
            free, remaining = saturated == 0.0, remaining - 1
            motors = np.where(free, commanded, self.limit * saturated)
            accelerations = accelerate(
                np.where(free, rotor_inertia, 0.0) + step_s * friction_damping, motors + friction
            )
            torques = np.where(free, commanded - rotor_inertia * accelerations.qdd, motors)
            beyond = free & (np.abs(torques) > self.limit)
            if not remaining or not beyond.any():
                return torques, accelerations
            saturated[beyond] = np.sign(torques[beyond])


class ServoChain:
    """Chain whose hinges have the servos of one robot: what all robots share.

    Attributes:
        chain: The chain.
        errors: Model errors of the robot.
        state: Present state of the simulated hinges and of the root.
        engine: Dynamics of the simulated bodies.

    Args:
        chain: The chain.
        errors: Model errors of the robot.
        step_s: Time step, s.
    """

    def __init__(self, chain: Chain, errors: RobotErrors, step_s: float) -> None:
        self.chain = chain
        self.errors = errors
        self.state: State
        self._step_s = step_s
        self.engine: Engine
        self._centre: Array

    def find_contacts(self) -> DetectedContacts | None:
        """Return the contacts of the present state, in the world frame."""
        raise NotImplementedError

    def _advance(self, hinges: slice, target: ServoTarget) -> Array:
        """Integrate one step, and return the (H,) motor torques.

        Args:
            hinges: Slice of the simulated hinges in the chain.
            target: Setpoint for the end of the step.

        Raises:
            SimulationError: The state is not finite.
        """
        engine, state, contacts = self.engine, self.state, self.find_contacts()
        forces, torque = np.zeros_like(engine.positions), np.zeros(3)

        def accelerate(rotor_inertias: Array, torques: Array) -> Accelerations:
            return engine.constrained(
                state, Loads(torques, rotor_inertias, forces, torque), contacts
            )

        torques, accelerations = self.errors.drive(hinges, state, target, self._step_s, accelerate)
        if not advance(
            self._reduced,
            accelerations,
            self._step_s,
            engine.stop_rad,
            engine.chain_model,
            engine.modules,
        ):
            raise SimulationError("the simulated state became infinite or undefined.")
        return torques

    def stop_drifting(self) -> None:
        """Remove the momentum that integration has added since the chain was at rest."""
        engine = self.engine
        remove_net_momentum(engine.chain_model, self._centre, self._reduced, engine.modules)

    @property
    def _reduced(self) -> ReducedState:
        """Arrays of the state, as kernels take them."""
        s = self.state
        return ReducedState(s.angles, s.rates, s.position, s.rotation, s.velocity, s.spin)


class Robot(ServoChain):
    """Robot of which all hinges are simulated.

    Args:
        chain: The chain.
        contacts: Finder of the contacts of all modules, which is copied, see ``robot_contacts``.
        parameters: Kind of robot.
        peak_torque: Largest torque of the plan, which limit and friction are relative to.
        seed: Whole numbers that identify the robot among those of its kind.
        step_s: Time step, s.
    """

    def __init__(
        self,
        chain: Chain,
        contacts: ContactFinder,
        parameters: RobotParameters,
        *,
        peak_torque: float,
        seed: list[int],
        step_s: float,
    ) -> None:
        errors = RobotErrors(chain, parameters, peak_torque=peak_torque, seed=seed)
        super().__init__(chain, errors, step_s)
        model = build_chain_model(chain, root=chain.root, masses=errors.masses)
        self.engine = Engine(model, chain.module.angle_limit_rad)
        self._contacts = contacts.copy()
        hinges = len(chain.folded_rad)
        self._target = ServoTarget(np.zeros(hinges), np.zeros(hinges), np.zeros(hinges))
        self.motor_torques = np.zeros(hinges)
        """(J,) torques of the motors in the last step."""

    @property
    def angles(self) -> Array:
        """(J,) a copy of the hinge angles, rad."""
        return self.state.angles.copy()

    @property
    def rates(self) -> Array:
        """(J,) a copy of the hinge velocities, rad/s."""
        return self.state.rates.copy()

    @property
    def centres(self) -> Array:
        """(n, 3) centres of the modules relative to their mean, pitches."""
        centres = self.engine.positions
        return centres - centres.mean(axis=0)

    @property
    def root_position(self) -> Array:
        """(3,) a copy of the root's centre, pitches."""
        return self.state.position.copy()

    @property
    def root_wxyz(self) -> Array:
        """(4,) orientation of the root, w first."""
        return wxyz_from_matrix(self.state.rotation)

    def place(self, angles: Array, root_position: Array, root_wxyz: Array) -> None:
        """Set a configuration at rest."""
        self.state = State.at_rest(angles, root_position, matrix_from_wxyz(root_wxyz))
        self.engine.place(self.state)
        self._centre = self.engine.centre_of_mass

    def begin_step(self) -> None:
        """Do nothing: poses are those of the present state at any time."""

    def follow(self, angles: Array, rates: Array, torques: Array) -> None:
        """Set the setpoint of the servos for the end of the coming step.

        Args:
            angles, rates: (J,) hinge angles, rad, and rates, rad/s.
            torques: (J,) torques that a robot without model errors needs.
        """
        self._target = ServoTarget(angles, rates, torques)

    def end_step(self) -> None:
        """Integrate one step; raise ``SimulationError`` if the state is not finite."""
        self.motor_torques = self._advance(slice(0, len(self.state.angles)), self._target)

    def find_contacts(self) -> DetectedContacts | None:
        """Return the contacts of the present state, in the world frame."""
        return self._contacts.find(self.engine.positions, self.engine.rotations)
