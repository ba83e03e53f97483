"""Robot: a chain as it is built, with model errors, motors of limited torque and a servo per hinge.

Modules are heavier or lighter than the planner assumes, joints have dry friction, and encoders have
a resolution, noise and an offset. The servo of a hinge gives

    τ = kp (q* − q_measured) + kv (q̇* − q̇) + τ_feedforward,   |τ| ≤ limit,

evaluated at the end of the step, as MuJoCo's implicit integrators do: its stiffness and damping act
as a rotor inertia h² kp + h kv of the hinge, and it is stable for any stiffness.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.rotations import matrix_from_wxyz
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
    Lumps,
    ModuleStates,
    ReducedState,
    RobotServos,
    RobotStates,
    ServoTarget,
    ServoTargets,
)
from foldback.planner.core.structures import RobotTeam as TeamBody
from foldback.planner.errors import SimulationError
from foldback.planner.parameters.playback import RobotParameters
from foldback.planner.simulation.contact_finder import ContactFinder, robot_contacts
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
        errors = 1.0 + parameters.mass_error * rng.standard_normal(n)
        self.masses = chain.module.masses(n) * errors
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
            engine.stops,
            engine.chain_model,
            engine.modules,
        ):
            raise SimulationError("the simulated state became infinite or undefined.")
        return torques

    def stop_drifting(self) -> None:
        """Remove the momentum that integration has added since the chain was at rest."""
        engine = self.engine
        remove_net_momentum(engine.chain_model, self._centre, self.state.reduced, engine.modules)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FollowedSteps:
    """Steps of R robots towards the same S setpoints.

    Attributes:
        states: States of the robots before the first step, and after each.
        made: (R,) number of steps that each robot has made.
        broken: Why a robot made fewer, by its number; robots that have ended before are left out.
    """

    states: RobotStates
    made: Ints
    broken: dict[int, SimulationError]


class Robot(ServoChain):
    """Robot of a team, of which all hinges are simulated.

    Args:
        chain: The chain.
        find_contacts: Returns the contacts of modules with such centres and orientations.
        errors: Model errors of the robot.
        step_s: Time step, s.
        state: Arrays of its state among those of the team.
        modules: Arrays of its modules.
    """

    def __init__(
        self,
        chain: Chain,
        find_contacts: Callable[[Array, Array], DetectedContacts | None],
        errors: RobotErrors,
        step_s: float,
        state: ReducedState,
        modules: ModuleStates,
    ) -> None:
        super().__init__(chain, errors, step_s)
        model = build_chain_model(chain, root=chain.root, masses=errors.masses)
        self.engine = Engine(model, chain.stops_rad(), modules)
        self.state = State(
            angles=state.q,
            rates=state.qd,
            position=state.position,
            rotation=state.rotation,
            velocity=state.velocity,
            spin=state.angular_velocity,
        )
        self._find_contacts = find_contacts

    def place(self, angles: Array, root_position: Array, root_wxyz: Array) -> Array:
        """Set a configuration at rest, and return the (3,) centre of mass."""
        state = self.state
        state.angles[:], state.position[:] = angles, root_position
        state.rotation[:] = matrix_from_wxyz(root_wxyz)
        for velocities in (state.rates, state.velocity, state.spin):
            velocities[:] = 0.0
        self.engine.place(state)
        self._centre = self.engine.centre_of_mass
        return self._centre

    def step(self, target: ServoTarget, noise: Array) -> Array:
        """Make one step, with contacts and stops, and return the (J,) torques of the motors.

        Raises:
            SimulationError: The state is not finite.
        """
        torques = self._advance(slice(0, len(self.state.angles)), target, noise)
        self.stop_drifting()
        return torques

    def find_contacts(self) -> DetectedContacts | None:
        """Return the contacts of the present state, in the world frame."""
        return self._find_contacts(self.engine.positions, self.engine.rotations)


class RobotTeam:
    """Robots that fold the same chain with the same setpoints, each with errors of its own.

    Steps without contacts and stops are made in one compiled loop for all of them. A robot that
    needs such a step makes it by itself.

    Attributes:
        robots: The robots.

    Args:
        chain: The chain.
        parameters: Kind of robot.
        peak_torque: Largest torque of the plan, which limit and friction are relative to.
        seeds: Whole numbers that identify each robot among those of its kind.
        geom_size: Size of the colliding modules as a fraction of the pitch.
        step_s: Time step, s.
    """

    def __init__(
        self,
        chain: Chain,
        parameters: RobotParameters,
        *,
        peak_torque: float,
        seeds: Sequence[list[int]],
        geom_size: float,
        step_s: float,
    ) -> None:
        self._chain, self._geom_size, self._step_s = chain, geom_size, step_s
        count, hinges, n = len(seeds), len(chain.folded_rad), len(chain)
        shapes = ((hinges,), (hinges,), (3,), (3, 3), (3,), (3,))
        self._state = ReducedState(*(np.zeros((count, *shape)) for shape in shapes))
        shapes = ((n, 3), (n, 3, 3), (n, 3), (n, 3))
        self._modules = ModuleStates(*(np.zeros((count, *shape)) for shape in shapes))
        self.robots = [
            Robot(
                chain,
                self._find_contacts,
                RobotErrors(chain, parameters, peak_torque=peak_torque, seed=seed),
                step_s,
                ReducedState(*(array[number] for array in self._state)),
                ModuleStates(*(array[number] for array in self._modules)),
            )
            for number, seed in enumerate(seeds)
        ]
        self._follows = np.ones(count, dtype=bool)
        errors = [robot.errors for robot in self.robots]
        first = self.robots[0]
        self.body = TeamBody(
            joint=chain.module.joint,
            masses=np.array([each.masses for each in errors]),
            inertia=chain.module.moments,
            lumps=Lumps(*(np.array([array] * count) for array in Lumps.none())),
            root=chain.root,
            servos=errors[0]
            .servos(slice(None))
            ._replace(
                offsets=np.array([each.offsets for each in errors]),
                friction=np.array([each.friction for each in errors]),
            ),
            hull=chain.module.hull,
            size=geom_size,
            centres=np.zeros((count, 3)),
            step_s=step_s,
            stops=first.engine.stops,
        )

    @cached_property
    def _contacts(self) -> ContactFinder:
        """Finder of contacts; most robots never touch anything, and its model takes a while."""
        contacts = robot_contacts(self._chain, geom_size=self._geom_size, step_s=self._step_s)
        contacts.allocate(len(self._chain))
        return contacts

    def _find_contacts(self, positions: Array, rotations: Array) -> DetectedContacts | None:
        return self._contacts.find(positions, rotations)

    def place(self, angles: Array, root_position: Array, root_wxyz: Array) -> None:
        """Set a configuration at rest."""
        for centre, robot in zip(self.body.centres, self.robots, strict=True):
            centre[:] = robot.place(angles, root_position, root_wxyz)

    def end(self, number: int) -> None:
        """Let a robot make no more steps."""
        self._follows[number] = False

    def follow(self, targets: ServoTargets) -> FollowedSteps:
        """Make the S steps towards setpoints for their ends."""
        steps, hinges = targets.q.shape
        noise = np.zeros((len(self.robots), steps, hinges))
        for number in np.flatnonzero(self._follows):
            noise[number] = self.robots[number].errors.draw_noise(steps, hinges)
        states = RobotStates.empty(len(self.robots), steps, hinges)
        for rows, present in zip(states[:4], self._state, strict=False):
            rows[:, 0] = present
        made, broken = np.zeros(len(self.robots), np.int64), dict[int, SimulationError]()
        while self._follows.any():
            self._make_steps(targets, noise, states, made)
            late = np.flatnonzero((made < steps) & self._follows).tolist()
            if not late:
                break
            for number in late:
                try:
                    self._make_step(number, targets, noise, states, made)
                except SimulationError as error:
                    broken[number] = error
                    self.end(number)
        return FollowedSteps(states=states, made=made, broken=broken)

    def _make_steps(
        self, targets: ServoTargets, noise: Array, states: RobotStates, made: Ints
    ) -> None:
        """Make as many of the steps as have no contacts and stops."""
        ended = np.where(self._follows, made, len(targets.q))
        robot_steps(self.body, targets, noise, self._state, self._modules, states, ended)
        np.copyto(made, ended, where=self._follows)

    def _make_step(
        self, number: int, targets: ServoTargets, noise: Array, states: RobotStates, made: Ints
    ) -> None:
        """Make the next step of one robot, with contacts and stops."""
        k = made[number]
        target = ServoTarget(*(array[k] for array in targets))
        states.torques[number, k] = self.robots[number].step(target, noise[number, k])
        for rows, present in zip(states[:4], self._state, strict=False):
            rows[number, k + 1] = present[number]
        made[number] += 1
