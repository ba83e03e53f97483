"""Window robot: a robot that folds a long chain, of which one stretch of joints moves at a time.

The folded core and the straight tail are rigid lumps at both ends of that stretch. Hinges that join
the core are latched at their folded angles; those of the tail are latched straight.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.chain.rotations import matrix_from_wxyz, wxyz_from_matrix
from foldback.planner.core.structures import ChainModel, Lumps, PairContacts, ServoTarget
from foldback.planner.parameters.playback import RobotParameters
from foldback.planner.simulation.contact_finder import boxes_around, robot_contacts
from foldback.planner.simulation.engine import DetectedContacts, Engine
from foldback.planner.simulation.reduced_state import State
from foldback.planner.simulation.robot import RobotErrors, ServoChain


class RigidEnds:
    """Folded core and straight tail of a chain, for every position of its window.

    Args:
        chain: Chain of cubes.
        masses: (n,) masses of its modules, in module masses.
    """

    def __init__(self, chain: Chain, masses: Array) -> None:
        self._folded = forward_kinematics(chain.module, chain.folded_rad)
        self._straight = forward_kinematics(chain.module, np.zeros_like(chain.folded_rad))
        inertia = chain.module.moments[chain.module.joint.row(np.arange(len(chain)))]
        self._core = _moments(masses, inertia, self._folded.positions, self._folded.rotations)
        straight = (self._straight.positions[::-1], self._straight.rotations[::-1])
        tail_moments = _moments(masses[::-1], inertia[::-1], *straight)
        self._tail = tuple(sums[::-1] for sums in tail_moments)

    def lumps(self, core: int, tail: int) -> Lumps:
        """Return modules before ``core`` and those behind ``tail``, in the frames of these two."""
        lumps = Lumps.none()
        for end, sums, poses, module, outermost in (
            (0, self._core, self._folded, core, core - 1),
            (1, self._tail, self._straight, tail, tail + 1),
        ):
            if not 0 <= outermost < len(poses.positions):
                continue
            mass, first, second = (sums_of_end[outermost] for sums_of_end in sums)
            position, rotation = poses.positions[module], poses.rotations[module]
            centre = first / mass
            about = mass * ((centre @ centre) * np.eye(3) - np.outer(centre, centre))
            lumps.masses[end] = mass
            lumps.centres[end] = rotation.T @ (centre - position)
            moments, axes = np.linalg.eigh(rotation.T @ (second - about) @ rotation)
            lumps.moments[end], lumps.axes[end] = moments, axes
        return lumps

    def folded_pose(self, module: int) -> tuple[Array, Array]:
        """Return (3,) centre and (3, 3) orientation of a folded module in the frame of module 0."""
        return self._folded.positions[module], self._folded.rotations[module]

    def boxes(self, core: int) -> tuple[Array, Array]:
        """Return (B, 3) centres and half sides of boxes around the folded modules before ``core``.

        They are in the frame of module ``core``, whose axes are those of the lattice.
        """
        position, rotation = self.folded_pose(core)
        cells = (self._folded.positions[:core] - position) @ rotation
        return boxes_around(np.rint(cells).astype(np.int64))


def _moments(
    masses: Array, inertia: Array, positions: Array, rotations: Array
) -> tuple[Array, Array, Array]:
    """Return mass, first and second moment, (n,), (n, 3), (n, 3, 3), of modules up to each one."""
    own_inertia = (rotations * inertia[:, None]) @ rotations.transpose(0, 2, 1)
    squares = (positions**2).sum(axis=1)
    about = squares[:, None, None] * np.eye(3) - positions[:, :, None] * positions[:, None, :]
    return (
        np.cumsum(masses),
        np.cumsum(masses[:, None] * positions, axis=0),
        np.cumsum(masses[:, None, None] * (own_inertia + about), axis=0),
    )


class WindowRobot(ServoChain):
    """Robot of which a stretch of joints is simulated at a time.

    Args:
        chain: The chain.
        parameters: Kind of robot.
        peak_torque: Largest torque of the plan, which limit and friction are relative to.
        seed: Whole numbers that identify the robot among those of its kind.
        base: (3,) centre and (4,) orientation of module 0, at rest.
        geom_size: Size of the colliding modules as a fraction of the pitch.
        step_s: Time step, s.
    """

    def __init__(
        self,
        chain: Chain,
        parameters: RobotParameters,
        *,
        peak_torque: float,
        seed: list[int],
        base: tuple[Array, Array],
        geom_size: float,
        step_s: float,
    ) -> None:
        errors = RobotErrors(chain, parameters, peak_torque=peak_torque, seed=seed)
        super().__init__(chain, errors, step_s)
        self._ends = RigidEnds(chain, errors.masses)
        self._contacts = robot_contacts(chain, geom_size=geom_size, step_s=step_s)
        self._hinges = slice(0, 0)
        self._core = 0
        self.state = State.at_rest(np.zeros(0), base[0], matrix_from_wxyz(base[1]))

    @property
    def angles(self) -> Array:
        """(H,) hinge angles of the stretch, rad."""
        return self.state.angles

    @property
    def base_pose(self) -> tuple[Array, Array]:
        """(3,) centre of module 0, and (4,) its orientation."""
        position, rotation = self._base()
        return position, wxyz_from_matrix(rotation)

    def _base(self) -> tuple[Array, Array]:
        """Return (3,) centre and (3, 3) orientation of module 0."""
        folded_position, folded_rotation = self._ends.folded_pose(self._core)
        rotation = self.state.rotation @ folded_rotation.T
        return self.state.position - rotation @ folded_position, rotation

    def take(self, first: int, joints: int) -> None:
        """Continue with another stretch, from the present hinge angles and rates.

        Args:
            first: Its first joint, between the modules ``first + 1`` and ``first + 2``.
            joints: Number of joints.
        """
        module, is_first = self.chain.module, self._core == 0
        position, rotation = self._base()
        before, k = self._hinges, module.hinges_per_joint
        start, stop = k * first, k * (first + joints)
        angles, rates = np.zeros(stop - start), np.zeros(stop - start)
        folded = max(start, min(before.start, stop))
        angles[: folded - start] = self.chain.folded_rad[start:folded]
        low, high = max(start, before.start), min(stop, before.stop)
        if high > low:
            shared = slice(low - start, high - start)
            old = slice(low - before.start, high - before.start)
            angles[shared], rates[shared] = self.state.angles[old], self.state.rates[old]
        self._hinges, self._core = slice(start, stop), first + 1
        core, tail = first + 1, first + 1 + joints
        masses = self.errors.masses[core : tail + 1]
        lumps = self._ends.lumps(core, tail)
        model = ChainModel(module.joint.window(core), masses, module.moments, lumps, False, 0)
        stops = self.chain.stops_rad(joints=slice(first, first + joints))
        self.engine = Engine(model, stops)
        folded_position, folded_rotation = self._ends.folded_pose(core)
        self.state = State.at_rest(
            angles, position + rotation @ folded_position, rotation @ folded_rotation
        )
        self.state.rates = rates
        self.engine.place(self.state)
        if is_first:
            self._centre = self.engine.centre_of_mass
        self.stop_drifting()
        self._contacts.set_boxes(*self._ends.boxes(core))
        self._contacts.allocate(joints + 1, len(self.chain) - 1 - tail)

    def step(self, angles: Array, rates: Array, torques: NDArray[np.floating]) -> Array:
        """Integrate one step, and return the (H,) torques of the motors.

        Args:
            angles, rates: (H,) hinge angles, rad, and rates, rad/s, at the step's end.
            torques: (H,) torques that a robot without model errors needs.

        Raises:
            SimulationError: The state is not finite.
        """
        target = ServoTarget(angles, rates, np.asarray(torques, dtype=np.float64))
        noise = self.errors.draw_noise(1, len(angles))[0]
        motors = self._advance(self._hinges, target, noise)
        self.stop_drifting()
        return motors

    def find_contacts(self) -> DetectedContacts | None:
        """Return the contacts of the present state, found in the frame of the core."""
        engine = self.engine
        position, rotation = engine.positions[0].copy(), engine.rotations[0].copy()
        contacts = self._contacts.find(
            (engine.positions - position) @ rotation, rotation.T @ engine.rotations
        )
        if contacts is None:
            return None
        pairs, normals, points, depths = contacts.points
        return DetectedContacts(
            points=PairContacts(
                pairs, normals @ rotation.T, points @ rotation.T + position, depths
            ),
            model=contacts.model,
        )
