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
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.rotations import matrix_from_wxyz
from planner.errors import SimulationError
from planner.kernels.articulated import add_contacts, articulated, free_accelerations
from planner.kernels.clearance import least_separation
from planner.kernels.kinematics import chain_poses
from planner.kernels.roots import write_root_velocities, write_state
from planner.kernels.velocities import chain_velocities
from planner.simulation.model import (
    SEGMENT_MODULES,
    Base,
    Material,
    Rod,
    compiled,
    segment_spec,
    segment_starts,
)
from planner.simulation.mujoco import mujoco

Array = NDArray[np.float64]
BIAS_STEP_S: Final = 1e-4
"""Time step of the finite difference that gives the accelerations of contacts at rest rates."""
FREE_ABOVE: Final = 1e-6
"""Distance in pitches from which on two hulls are not in contact."""
HELD: Final = 1e12
"""Rotor inertia of a hinge that is held at its stop."""
MOST_HELD: Final = 3
"""Times that accelerations are worked out anew to find which hinges their stops hold."""
MOST_PIVOTED: Final = 500
"""Contact points up to which their forces are found exactly; of more, to some per cent."""
WELD_STIFFENING: Final = 1e-4
"""Factor of the bodies' inverse weights in MuJoCo's regularisation of weld rows."""


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


class Segments:
    """A chain as MuJoCo's segments. Holds a model and its data.

    Without a base the root of the state is the chain's middle module. With one it is module 0,
    which does not move; and a rod may be fixed to the last module, see
    ``planner.simulation.model``.
    """

    def __init__(
        self,
        chain: Chain,
        material: Material,
        *,
        segment_modules: int = SEGMENT_MODULES,
        base: Base | None = None,
        rod: Rod | None = None,
    ) -> None:
        self.chain = chain
        self.root = chain.root if base is None else 0
        self._geom_size = material.geom_size
        self._armature = np.full(len(chain.folded_rad), float(material.armature))
        self._stop_rad = material.stop_of(chain.module)
        starts = segment_starts(chain, segment_modules, root=self.root)
        self.starts = np.array(starts if base is None else starts[1:], dtype=np.int64)
        self.model: Any = compiled(segment_spec(chain, material, starts, base=base, rod=rod))
        self._set_options()
        self.data: Any = mujoco.MjData(self.model)
        names = chain.joint_names
        joints = [self.model.joint(name) for name in names]
        self._hinge_qpos = np.array([j.qposadr[0] for j in joints], dtype=np.int64)
        self.hinge_dofs = np.array([j.dofadr[0] for j in joints], dtype=np.int64)
        """(J,) where the hinges' velocities are among the model's."""
        roots = [self.model.joint(f"root_{start}") for start in self.starts]
        self._root_qpos = np.array([j.qposadr[0] for j in roots], dtype=np.int64)
        self._root_dofs = np.array([j.dofadr[0] for j in roots], dtype=np.int64)
        self._middle = int(np.flatnonzero(self.starts == self.root)[0]) if base is None else None
        self._hinge_ids = np.array([j.id for j in joints], dtype=np.int64)
        self._bodies = np.array([self.model.body(f"module_{i}").id for i in range(len(chain))])
        self._make_room()
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
        twin._make_room()
        return twin

    @property
    def motion(self) -> tuple[Array, Array, Array, Array]:
        """Positions, rotations, velocities and spins of all modules, as placed last."""
        return self.positions, self.rotations, self.velocities, self.spins

    def _make_room(self) -> None:
        """What is written to in every step."""
        n = len(self.chain)
        self.positions, self.velocities, self.spins = (np.empty((n, 3)) for _ in range(3))
        self.rotations = np.empty((n, 3, 3))
        self._ahead = (np.empty((n, 3)), np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3)))
        self._bias = np.zeros(self.model.nv)
        self._articulated = articulated(n, self.chain.module.hinges_per_joint)

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
        self.model.jnt_stiffness[self._hinge_ids] = stiffness

    def place(self, state: State) -> None:
        """Writes poses and velocities of all modules for a state, see the attributes."""
        self._kinematics(state, self.positions, self.rotations, self.velocities, self.spins)

    def place_velocities(self, state: State) -> None:
        """Writes the velocities alone, for a state whose poses are those placed last."""
        self._move(state, self.positions, self.rotations, self.velocities, self.spins)

    def accelerations(
        self, state: State, forces: Array | None, *, end_torque: Array | None = None
    ) -> Acceleration:
        """The acceleration of a state under forces on the modules.

        ``place`` must have been called for the same state.

        Args:
            state: The reduced state.
            forces: (n, 3) at the modules' centres, in the world; None for none at any time.
            end_torque: (3,) on the last module, in the world; none by default.

        Raises:
            SimulationError: When MuJoCo warns of bad numbers.
        """
        model, data = self.model, self.data
        self._write(state)
        if forces is not None:
            data.xfrc_applied[self._bodies, :3] = forces
        if end_torque is not None:
            data.xfrc_applied[self._bodies[-1], 3:] = end_torque
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
        root = np.zeros(6)
        if self._middle is not None:
            at = self._root_dofs[self._middle]
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
            self.positions,
            self.rotations,
            self.velocities,
            self.spins,
            self.starts,
            self._hinge_qpos,
            self.hinge_dofs,
            self._root_qpos,
            self._root_dofs,
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
        if np.abs(state.angles).max() >= self._stop_rad:
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

    def free_accelerations(self, state: State, forces: Array) -> Acceleration:
        """The acceleration of a state in which nothing touches and no hinge is at its stop.

        The same as ``accelerations`` gives, in a tenth of the time. ``place`` must have been called
        for the same state.

        Args:
            state: The reduced state of a chain without a base.
            forces: (n, 3) at the modules' centres, in the world.

        Raises:
            SimulationError: When the numbers are bad.
        """
        return self._accelerations_of(state, *self._free(state, forces, self._armature))

    def lean_accelerations(
        self, state: State, forces: Array, near: NDArray[np.int64]
    ) -> Acceleration:
        """``accelerations`` in a tenth of the time.

        MuJoCo finds the contacts, and their forces follow its equations; the chain's answer to them
        is that of one tree, without welds. ``place`` must have been called for the same state.
        A hinge at its stop does not go on: it is held, and let go where it would come back. Who
        integrates brings hinges back to their stops by ``State.stop_at``.

        Args:
            state: The reduced state of a chain without a base.
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
        outwards = np.sign(state.angles) * (np.abs(state.angles) >= self._stop_rad)
        held = outwards != 0.0
        hinges, root = self._touching(state, forces, held)
        for _ in range(MOST_HELD):
            wrong = ((outwards * hinges > 0.0) != held) & (outwards != 0.0)
            if not wrong.any():
                break
            held ^= wrong
            hinges, root = self._touching(state, forces, held)
        depth = float(-data.contact.dist.min()) if data.ncon else 0.0
        return self._accelerations_of(state, hinges, root, contacts=data.ncon, depth=depth)

    def _touching(
        self, state: State, forces: Array, held: NDArray[np.bool_]
    ) -> tuple[Array, Array]:
        """Accelerations as from ``_free`` under the contacts found last, some hinges held still."""
        data, solref = self.data, self.data.contact.solref
        armature = np.where(held, HELD, self._armature)
        hinges, root = self._free(state, forces, armature)
        if data.ncon:
            contact = data.contact
            add_contacts(
                self._module_of_geom[contact.geom],
                np.ascontiguousarray(contact.frame[:, :3]),
                contact.pos,
                -contact.dist,
                (max(float(solref[0, 0]), 2.0 * self.model.opt.timestep), solref[0, 1]),
                contact.solimp[0],
                MOST_PIVOTED,
                self._articulated,
                self.chain.module.joint,
                self.root,
                self.positions,
                self.velocities,
                self.spins,
                hinges,
                root,
            )
        return hinges, root

    def _free(self, state: State, forces: Array, armature: Array) -> tuple[Array, Array]:
        """(J,) hinge accelerations and (6,) the root's, angular first, where nothing touches."""
        hinges, root = np.empty_like(state.angles), np.empty(6)
        free_accelerations(
            state.angles,
            state.rates,
            -self.model.jnt_stiffness[self._hinge_ids] * state.angles,
            forces,
            self.chain.module.joint,
            self.chain.module.inertia,
            armature,
            self.root,
            self.positions,
            self.rotations,
            self.spins,
            self._articulated,
            hinges,
            root,
        )
        return hinges, root

    @staticmethod
    def _accelerations_of(
        state: State, hinges: Array, root: Array, *, contacts: int = 0, depth: float = 0.0
    ) -> Acceleration:
        if not np.isfinite(hinges).all():
            raise SimulationError("the accelerations are no longer finite.")
        return Acceleration(
            hinges=hinges,
            linear=root[3:],
            angular=state.rotation.T @ root[:3],
            contacts=contacts,
            depth=depth,
        )

    def _add_bias_to_contacts(self, state: State) -> None:
        data = self.data
        ahead = state.copy()
        ahead.advance(BIAS_STEP_S)
        positions, rotations, velocities, spins = self._ahead
        self._kinematics(ahead, positions, rotations, velocities, spins)
        # Constant hinge velocities: only those of the roots change.
        bias = self._bias
        bias[:] = data.qvel
        write_root_velocities(rotations, velocities, spins, self.starts, self._root_dofs, bias)
        bias -= data.qvel
        bias /= BIAS_STEP_S
        rows = np.empty(data.nefc)
        mujoco.mj_mulJacVec(self.model, data, rows, self._bias)
        contact = data.efc_type >= int(mujoco.mjtConstraint.mjCNSTR_CONTACT_FRICTIONLESS)
        data.efc_aref[contact] += rows[contact]

    def _kinematics(
        self, state: State, positions: Array, rotations: Array, velocities: Array, spins: Array
    ) -> None:
        module, root = self.chain.module, self.root
        chain_poses(
            state.angles, module.joint, root, state.position, state.rotation, positions, rotations
        )
        self._move(state, positions, rotations, velocities, spins)

    def _move(
        self, state: State, positions: Array, rotations: Array, velocities: Array, spins: Array
    ) -> None:
        module, root = self.chain.module, self.root
        chain_velocities(
            state.angles,
            state.rates,
            module.joint,
            root,
            state.velocity,
            state.rotation @ state.spin,
            positions,
            rotations,
            velocities,
            spins,
        )
