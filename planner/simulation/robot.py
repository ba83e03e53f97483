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
from foldback.planner.core import (
    MAX_SERVO_PASSES,
    advance,
    remove_net_momentum,
    robot_steps,
    servo_torques,
)
from foldback.planner.core.structures import (
    Accelerations,
    Loads,
    RobotBody,
    RobotServos,
    RobotStates,
    ServoTarget,
    ServoTargets,
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

    def draw_noise(self, steps: int, hinges: int) -> Array:
        """Draw the (S, H) noise of the encoders in coming steps, rad."""
        return self._noise_rad * self._rng.standard_normal((steps, hinges))

    def servos(self, hinges: slice) -> RobotServos:
        """Return the servos of some hinges."""
        return RobotServos(
            self.offsets[hinges],
            self.friction[hinges],
            self.encoder_rad,
            self.stiffness,
            self.damping,
            self.expected_friction,
            self.limit,
        )

    def drive(
        self,
        hinges: slice,
        state: State,
        target: ServoTarget,
        noise: Array,
        step_s: float,
        accelerate: Callable[[Array, Array], Accelerations],
    ) -> tuple[Array, Accelerations]:
        """Return (H,) motor torques in a step, and the accelerations under them.

        The step is computed anew while motors are beyond their limit; they then give the limit.

        Args:
            hinges: Slice of the state's hinges in the chain.
            state: Present state.
            target: Setpoint for the end of the step.
            noise: (H,) noise of the encoders, rad.
            step_s: Time step, s.
            accelerate: Returns accelerations under (H,) rotor inertias and torques.
        """
        count = len(state.angles)
        commanded, friction_damping = np.empty(count), np.empty(count)
        servo_torques(
            state.angles,
            state.rates,
            target,
            noise,
            self.servos(hinges),
            step_s,
            commanded,
            friction_damping,
        )
        rotor_inertia = step_s * step_s * self.stiffness + step_s * self.damping
        friction = -friction_damping * state.rates
        saturated = np.zeros(count)
        remaining = MAX_SERVO_PASSES
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

    def _advance(self, hinges: slice, target: ServoTarget, noise: Array) -> Array:
        """Integrate one step, and return the (H,) motor torques.

        Args:
            hinges: Slice of the simulated hinges in the chain.
            target: Setpoint for the end of the step.
            noise: (H,) noise of the encoders, rad.

        Raises:
            SimulationError: The state is not finite.
        """
        engine, state, contacts = self.engine, self.state, self.find_contacts()
        forces, torque = np.zeros_like(engine.positions), np.zeros(3)

        def accelerate(rotor_inertias: Array, torques: Array) -> Accelerations:
            return engine.constrained(
                state, Loads(torques, rotor_inertias, forces, torque), contacts
            )

        torques, accelerations = self.errors.drive(
            hinges, state, target, noise, self._step_s, accelerate
        )
        if not advance(
            self.state.reduced,
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
        remove_net_momentum(engine.chain_model, self._centre, self.state.reduced, engine.modules)


class Robot(ServoChain):
    """Robot of which all hinges are simulated.

    Steps without contacts and stops are made in one compiled loop, as far ahead as setpoints are
    set; ``end_step`` goes on to the next of them.

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
        self._hinges = slice(0, len(chain.folded_rad))
        self.body: RobotBody
        self._targets: ServoTargets
        self._noise: Array
        self._states: RobotStates  # before the steps that targets are set for, and after each
        self._wxyzs: Array  # orientations of the root in these
        self._present = self._steps = 0  # numbers of steps that are shown, and that are made

    @property
    def angles(self) -> Array:
        """(J,) hinge angles, rad."""
        return self._states.q[self._present]

    @property
    def rates(self) -> Array:
        """(J,) hinge velocities, rad/s."""
        return self._states.qd[self._present]

    @property
    def motor_torques(self) -> Array:
        """(J,) torques of the motors in the last step."""
        return self._states.torques[self._present]

    @property
    def centres(self) -> Array:
        """(n, 3) centres of the modules relative to their mean, pitches."""
        centres = self.chain.poses(self.angles, self.root_position, self.root_wxyz).positions
        return centres - centres.mean(axis=0)

    @property
    def root_position(self) -> Array:
        """(3,) the root's centre, pitches."""
        return self._states.position[self._present]

    @property
    def root_wxyz(self) -> Array:
        """(4,) orientation of the root, w first."""
        return self._wxyzs[self._present]

    def place(self, angles: Array, root_position: Array, root_wxyz: Array) -> None:
        """Set a configuration at rest."""
        engine = self.engine
        self.state = State.at_rest(angles, root_position, matrix_from_wxyz(root_wxyz))
        engine.place(self.state)
        self._centre = engine.centre_of_mass
        self.body = RobotBody(
            engine.chain_model,
            self.errors.servos(self._hinges),
            self.chain.module.hull,
            self._contacts.geom_size,
            self._centre,
            self._step_s,
            engine.stop_rad,
        )
        self._begin(0)

    def begin_step(self) -> None:
        """Do nothing: poses are those of the present state at any time."""

    def follow(self, targets: ServoTargets) -> None:
        """Set the setpoints of the servos for the ends of the coming S steps.

        Those set before must have been followed.
        """
        steps, hinges = targets.q.shape
        self._targets, self._noise = targets, self.errors.draw_noise(steps, hinges)
        self._begin(steps)

    def end_step(self) -> None:
        """Go on by one step; raise ``SimulationError`` if the state is not finite."""
        if self._present == self._steps:
            self._simulate()
        self._present += 1

    def _begin(self, steps: int) -> None:
        """Allocate the states of coming steps; the first one is the present state."""
        self._states = RobotStates.empty(steps + 1, len(self.state.angles))
        self._wxyzs = np.empty((steps + 1, 4))
        self._present = self._steps = 0
        self._write_state(np.zeros_like(self.state.angles))

    def _write_state(self, torques: Array) -> None:
        """Write the state after the last step, with the (J,) torques of the motors in it."""
        state = self.state
        values = (state.angles, state.rates, state.position, state.rotation, torques)
        for states, value in zip(self._states, values, strict=True):
            states[self._steps] = value
        self._wxyzs[self._steps] = wxyz_from_matrix(state.rotation)

    def _simulate(self) -> None:
        """Make as many of the coming steps as have no contacts and stops, or else one step."""
        k = self._steps
        steps = robot_steps(
            self.body,
            ServoTargets(*(targets[k:] for targets in self._targets)),
            self._noise[k:],
            self.state.reduced,
            self.engine.modules,
            RobotStates(*(states[k + 1 :] for states in self._states)),
        )
        new_states = slice(k + 1, k + 1 + steps)
        self._wxyzs[new_states] = wxyz_from_matrix(self._states.rotation[new_states])
        self._steps += steps
        if steps == 0:
            self._simulate_step()

    def _simulate_step(self) -> None:
        """Make one step, with contacts and stops."""
        k = self._steps
        target = ServoTarget(*(targets[k] for targets in self._targets))
        torques = self._advance(self._hinges, target, self._noise[k])
        self.stop_drifting()
        self._steps += 1
        self._write_state(torques)

    def find_contacts(self) -> DetectedContacts | None:
        """Return the contacts of the present state, in the world frame."""
        return self._contacts.find(self.engine.positions, self.engine.rotations)
