"""Reduced: a chain as its hinges and one root, and how those accelerate.

Only the *reduced* state is integrated: all hinge angles and the pose of one root. Accelerations of
a chain that touches nothing come of an articulated-body pass; of one that does, MuJoCo finds the
contacts, whose forces come of a system of their own (``planner.kernels.articulated``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.rotations import matrix_from_wxyz
from planner.errors import SimulationError
from planner.kernels.articulated import (
    NO_TAIL,
    Accelerations,
    ArticulatedBodies,
    ChainModel,
    Loads,
    unconstrained_accelerations,
)
from planner.kernels.contact_forces import (
    ContactModel,
    PairContacts,
    add_contacts,
    add_many_contacts,
)
from planner.kernels.kinematics import chain_poses
from planner.kernels.module import ModuleStates
from planner.kernels.velocities import chain_velocities
from planner.simulation.model import Material

Array = NDArray[np.float64]
HELD: Final = 1e12
"""Rotor inertia of a hinge that is held at its stop."""
MOST_HELD: Final = 3
"""Times that accelerations are worked out anew to find which hinges their stops hold."""
MOST_PIVOTED: Final = 500
"""Contact points up to which their forces are found exactly; of more, to some per cent."""


@dataclass(slots=True, kw_only=True, eq=False)
class State:
    """The reduced state of a chain: what is integrated.

    Attributes:
        angles: (J,) hinge angles.
        rates: (J,) hinge velocities.
        position: (3,) root's centre in pitches.
        rotation: (3, 3) root's orientation.
        velocity: (3,) root's velocity in the world.
        spin: (3,) root's angular velocity in its own frame.
    """

    angles: Array
    rates: Array
    position: Array
    rotation: Array
    velocity: Array
    spin: Array

    @classmethod
    def at_rest(cls, angles: Array, position: Array, rotation: Array) -> State:
        """A state that does not move."""
        return cls(
            angles=angles.copy(),
            rates=np.zeros_like(angles),
            position=position.copy(),
            rotation=rotation.copy(),
            velocity=np.zeros(3),
            spin=np.zeros(3),
        )

    def copy(self) -> State:
        """A state that shares nothing with this one."""
        return State(
            angles=self.angles.copy(),
            rates=self.rates.copy(),
            position=self.position.copy(),
            rotation=self.rotation.copy(),
            velocity=self.velocity.copy(),
            spin=self.spin.copy(),
        )

    def scale_velocities(self, factor: float) -> None:
        """Multiplies all velocities."""
        self.rates *= factor
        self.velocity *= factor
        self.spin *= factor

    def accelerate(self, acceleration: Acceleration, step_s: float, drag: float) -> None:
        """q̇ ← (q̇ + h q̈) / (1 + αh), with a drag α that respects every linear constraint."""
        self.rates += step_s * acceleration.hinges
        self.velocity += step_s * acceleration.linear
        self.spin += step_s * acceleration.angular
        self.scale_velocities(1.0 / (1.0 + drag * step_s))

    def advance(self, step_s: float) -> None:
        """One step of the configuration: q ← q + h q̇."""
        self.angles += step_s * self.rates
        self.position += step_s * self.velocity
        if self.spin.any():
            self.rotation = self.rotation @ turned(self.spin * step_s)

    def stop_at(self, most_rad: float) -> None:
        """Leaves no hinge beyond its range: a simulated stop gives a little, a joint does not."""
        beyond = np.abs(self.angles) > most_rad
        if beyond.any():
            self.angles[beyond] = np.copysign(most_rad, self.angles[beyond])
            self.rates[beyond] = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Acceleration:
    """Second time derivative of the reduced state, and what contacts there were.

    Attributes:
        hinges: (J,).
        linear: (3,) of the root in the world.
        angular: (3,) of the root in its own frame.
        contacts: Number of contacts.
        depth: Deepest contact in pitches, 0 when there is none.
    """

    hinges: Array
    linear: Array
    angular: Array
    contacts: int
    depth: float


def turned(rotation_vector: Array) -> Array:
    """(3, 3) rotation by a rotation vector."""
    angle = float(np.linalg.norm(rotation_vector))
    half = 0.5 * angle
    scale = 0.5 if angle < 1e-12 else np.sin(half) / angle
    return matrix_from_wxyz(np.concatenate([[np.cos(half)], scale * rotation_vector]))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Found:
    """Contacts that MuJoCo has found.

    Attributes:
        pairs: (m, 2) modules that touch; the normal points to the second one.
        normals, points: (m, 3) in the world.
        depths: (m,) in pitches.
        solref: Time constant and damping ratio.
        solimp: (5,) impedance.
    """

    pairs: NDArray[np.int64]
    normals: Array
    points: Array
    depths: Array
    solref: tuple[float, float]
    solimp: Array

    @classmethod
    def of(cls, model: Any, data: Any, module_of_geom: NDArray[np.int64]) -> Found | None:
        """Those of a collision that was just worked out; None where nothing touches.

        Args:
            model, data: MuJoCo's.
            module_of_geom: The module that each geom belongs to.
        """
        if not data.ncon:
            return None
        contact, solref = data.contact, data.contact.solref[0]
        return cls(
            pairs=module_of_geom[contact.geom],
            normals=np.ascontiguousarray(contact.frame[:, :3]),
            points=np.ascontiguousarray(contact.pos),
            depths=-contact.dist,
            solref=(max(float(solref[0]), 2.0 * model.opt.timestep), float(solref[1])),
            solimp=contact.solimp[0],
        )


class ReducedChain:
    """A chain whose hinges and root are known, and what follows from them.

    Args:
        chain: The chain.
        material: Of its joints.
        root: The module whose pose is part of the state.
        fixed: Whether that module is held where it is; it is module 0 then.
    """

    def __init__(self, chain: Chain, material: Material, *, root: int, fixed: bool = False) -> None:
        self.chain = chain
        self.root = root
        self._fixed = fixed
        self._armature = np.full(len(chain.folded_rad), float(material.armature))
        self._stop_rad = material.stop_of(chain.module)
        self._stiffness = np.full(len(chain.folded_rad), float(material.stiffness))
        self._tail = NO_TAIL
        self._end_torque = np.zeros(3)
        self._make_room()

    def _make_room(self) -> None:
        """What is written to in every step."""
        n = len(self.chain)
        self.modules = ModuleStates.empty(n)
        """Poses and velocities of all modules, as placed last."""
        self.positions, self.rotations, self.velocities, self.spins = self.modules
        self._aba = ArticulatedBodies.zeros(n, self.chain.module.hinges_per_joint)

    def set_stiffness(self, stiffness: Array) -> None:
        """Springs of the (J,) hinges towards straight."""
        self._stiffness = stiffness

    def place(self, state: State) -> None:
        """Writes poses and velocities of all modules for a state, see the attributes."""
        self._kinematics(state, self.modules)

    def place_velocities(self, state: State) -> None:
        """Writes the velocities alone, for a state whose poses are those placed last."""
        self._move(state, self.modules)

    def free_accelerations(self, state: State, forces: Array) -> Acceleration:
        """The acceleration of a state in which nothing touches and no hinge is at its stop.

        The same as ``accelerations`` gives, in a tenth of the time. ``place`` must have been called
        for the same state.

        Args:
            state: The reduced state.
            forces: (n, 3) at the modules' centres, in the world.

        Raises:
            SimulationError: When the numbers are bad.
        """
        return self._accelerations_of(state, self._free(state, forces, self._armature))

    def _held_accelerations(
        self, state: State, forces: Array, contacts: Found | None
    ) -> Acceleration:
        """The acceleration of a state under some contacts, hinges at their stops held there.

        A hinge at its stop does not go on: it is held, and let go where it would come back. Who
        integrates brings hinges back to their stops by ``State.stop_at``.
        """
        outwards = np.sign(state.angles) * (np.abs(state.angles) >= self._stop_rad)
        held = outwards != 0.0
        found = self._touching(state, forces, held, contacts)
        for _ in range(MOST_HELD):
            wrong = ((outwards * found.qdd > 0.0) != held) & (outwards != 0.0)
            if not wrong.any():
                break
            held ^= wrong
            found = self._touching(state, forces, held, contacts)
        if contacts is None:
            return self._accelerations_of(state, found)
        return self._accelerations_of(
            state, found, contacts=len(contacts.depths), depth=float(contacts.depths.max())
        )

    def _touching(
        self, state: State, forces: Array, held: NDArray[np.bool_], contacts: Found | None
    ) -> Accelerations:
        """Accelerations as from ``_free`` under some contacts, some hinges held still."""
        armature = np.where(held, HELD, self._armature)
        found = self._free(state, forces, armature)
        if contacts is not None:
            arguments = (
                PairContacts(contacts.pairs, contacts.normals, contacts.points, contacts.depths),
                ContactModel(*contacts.solref, contacts.solimp),
                self._model,
                self.modules,
                self._aba,
                found,
            )
            if len(contacts.depths) > MOST_PIVOTED or not add_contacts(*arguments):
                add_many_contacts(*arguments)
        return found

    @property
    def _model(self) -> ChainModel:
        """Inertial parameters of the chain."""
        module = self.chain.module
        return ChainModel(module.joint, module.inertia, self._tail, self._fixed, self.root)

    def _free(self, state: State, forces: Array, armature: Array) -> Accelerations:
        """Accelerations of hinges and root where nothing touches."""
        q = state.angles
        loads = Loads(-self._stiffness * q, armature, forces, self._end_torque)
        found = Accelerations(np.empty_like(q), np.empty(6))
        unconstrained_accelerations(
            self._model, q, state.rates, loads, self.modules, self._aba, found
        )
        return found

    @staticmethod
    def _accelerations_of(
        state: State, found: Accelerations, *, contacts: int = 0, depth: float = 0.0
    ) -> Acceleration:
        if not np.isfinite(found.qdd).all():
            raise SimulationError("the accelerations are no longer finite.")
        return Acceleration(
            hinges=found.qdd,
            linear=found.root[3:],
            angular=state.rotation.T @ found.root[:3],
            contacts=contacts,
            depth=depth,
        )

    def _kinematics(self, state: State, out: ModuleStates) -> None:
        chain_poses(
            state.angles,
            self.chain.module.joint,
            self.root,
            state.position,
            state.rotation,
            out.positions,
            out.rotations,
        )
        self._move(state, out)

    def _move(self, state: State, out: ModuleStates) -> None:
        chain_velocities(
            state.angles,
            state.rates,
            self.chain.module.joint,
            self.root,
            state.velocity,
            state.rotation @ state.spin,
            out,
        )
