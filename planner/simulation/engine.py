"""Engine: forward dynamics of a chain by an articulated-body pass, with contacts and stops.

The chain floats, or its module 0 is held. Rigid lumps may be fixed to both of its ends: a folded
core, a straight tail. Each hinge has a torque and a rotor inertia; one at its stop is locked.
MuJoCo finds the contacts, whose forces follow from a system of their own
(``planner/core/contact_forces.cpp``). The time of a step is proportional to the number of modules.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from foldback.planner.arrays import Array, Flags, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.core import (
    add_contacts,
    add_many_contacts,
    chain_poses,
    chain_velocities,
    unconstrained_accelerations,
)
from foldback.planner.core.structures import (
    MAX_DIRECT_CONTACTS,
    Accelerations,
    ArticulatedBodies,
    ChainModel,
    ContactModel,
    Loads,
    Lumps,
    ModuleStates,
    PairContacts,
)
from foldback.planner.errors import SimulationError
from foldback.planner.simulation.mujoco_models import Material
from foldback.planner.simulation.reduced_state import Acceleration, State

LOCKED_ROTOR_INERTIA: Final = 1e12
"""Rotor inertia, module mass · pitch², of a hinge that its stop holds: so large that the hinge does
not accelerate. With smaller values hinges move past their stops, with larger ones accelerations
lose digits."""


def build_chain_model(
    chain: Chain,
    *,
    root: int,
    fixed_base: bool = False,
    masses: Array | None = None,
    lumps: Lumps | None = None,
) -> ChainModel:
    """Return the inertial parameters of a chain.

    Args:
        chain: The chain.
        root: Index of the module whose pose is part of the state.
        fixed_base: True if module 0 is held; it must be the root.
        masses: (n,) masses of the modules; 1 each by default. Inertias are in proportion.
        lumps: Rigid bodies at both ends; none by default.
    """
    return ChainModel(
        chain.module.joint,
        np.ones(len(chain)) if masses is None else masses,
        chain.module.inertia,
        Lumps.none() if lumps is None else lumps,
        fixed_base,
        root,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DetectedContacts:
    """Contacts that MuJoCo has found.

    Attributes:
        points: m contact points.
        model: Stiffness of all of them.
    """

    points: PairContacts
    model: ContactModel

    @classmethod
    def from_mujoco(cls, model: Any, data: Any, module_of_geom: Ints) -> DetectedContacts | None:
        """Return the contacts of a collision that was just computed; None if there are none.

        Args:
            model, data: Model and data of MuJoCo.
            module_of_geom: Index of the module that each geom belongs to.
        """
        if not data.ncon:
            return None
        contact, solref = data.contact, data.contact.solref[0]
        time_constant = max(float(solref[0]), 2.0 * model.opt.timestep)
        return cls(
            points=PairContacts(
                module_of_geom[contact.geom],
                np.ascontiguousarray(contact.frame[:, :3]),
                np.ascontiguousarray(contact.pos),
                -contact.dist,
            ),
            model=ContactModel(time_constant, float(solref[1]), contact.solimp[0]),
        )


class Engine:
    """Chain of rigid modules on hinges, and its accelerations under forces.

    Attributes:
        chain_model: Inertial parameters of the chain.
        modules: Poses and velocities of all modules, as placed last.
        positions, rotations, velocities, spins: Arrays of ``modules``.

    Args:
        chain_model: Inertial parameters of the chain.
        stop_rad: Angle of the hinges' stops, either way.
    """

    def __init__(self, chain_model: ChainModel, stop_rad: float) -> None:
        self.chain_model = chain_model
        self.stop_rad = stop_rad
        n, hinges = len(self.chain_model.masses), self.chain_model.joint.axes.shape[0]
        self.modules = ModuleStates.empty(n)
        self.positions, self.rotations, self.velocities, self.spins = self.modules
        self._aba = ArticulatedBodies.zeros(n, hinges)

    def place(self, state: State) -> None:
        """Compute poses and velocities of all modules of a state."""
        self._compute_kinematics(state, self.modules)

    @property
    def centre_of_mass(self) -> Array:
        """(3,) centre of mass of all modules and lumps, as placed last, pitches."""
        masses, lumps = self.chain_model.masses, self.chain_model.lumps
        ends = [0, -1]
        arms = (self.rotations[ends] @ lumps.centres[:, :, None])[:, :, 0]
        moment = masses @ self.positions + lumps.masses @ (self.positions[ends] + arms)
        return moment / (masses.sum() + lumps.masses.sum())

    def place_velocities(self, state: State) -> None:
        """Compute velocities alone, of a state whose poses are those placed last."""
        self._compute_velocities(state, self.modules)

    def constrained(
        self, state: State, loads: Loads, contacts: DetectedContacts | None
    ) -> Accelerations:
        """Return accelerations under contacts, hinges at their stops locked if they push outwards.

        ``place`` must have been called for the state. Callers that integrate bring hinges back to
        their stops with ``State.stop_at``.

        Args:
            state: The reduced state.
            loads: Forces, and rotor inertias.
            contacts: Contacts of the state; None if nothing touches.

        Raises:
            SimulationError: The accelerations are not finite.
        """
        outwards = np.sign(state.angles) * (np.abs(state.angles) >= self.stop_rad)
        locked = outwards != 0.0
        accelerations = self._locked(state, loads, locked, contacts)
        for _ in range(3 if locked.any() else 0):
            wrong = ((outwards * accelerations.qdd > 0.0) != locked) & (outwards != 0.0)
            if not wrong.any():
                break
            locked ^= wrong
            accelerations = self._locked(state, loads, locked, contacts)
        return _finite(accelerations)

    def unconstrained(self, state: State, loads: Loads) -> Accelerations:
        """Return accelerations without contacts and stops, see ``constrained``."""
        return _finite(self._free(state, loads))

    def _locked(
        self,
        state: State,
        loads: Loads,
        locked: Flags,
        contacts: DetectedContacts | None,
    ) -> Accelerations:
        """Return accelerations under contacts, some hinges locked."""
        rotor_inertias = np.where(locked, LOCKED_ROTOR_INERTIA, loads.rotor_inertias)
        accelerations = self._free(state, loads._replace(rotor_inertias=rotor_inertias))
        if contacts is not None:
            arguments = (
                contacts.points,
                contacts.model,
                self.chain_model,
                self.modules,
                self._aba,
                accelerations,
            )
            is_direct = len(contacts.points.depths) <= MAX_DIRECT_CONTACTS
            if not is_direct or not add_contacts(*arguments):
                add_many_contacts(*arguments)
        return accelerations

    def _free(self, state: State, loads: Loads) -> Accelerations:
        accelerations = Accelerations(np.empty_like(state.angles), np.empty(6))
        unconstrained_accelerations(
            self.chain_model,
            state.angles,
            state.rates,
            loads,
            self.modules,
            self._aba,
            accelerations,
        )
        return accelerations

    def _compute_kinematics(self, state: State, out: ModuleStates) -> None:
        joint, root = self.chain_model.joint, self.chain_model.root
        chain_poses(
            state.angles,
            joint,
            root,
            state.position,
            state.rotation,
            out.positions,
            out.rotations,
        )
        self._compute_velocities(state, out)

    def _compute_velocities(self, state: State, out: ModuleStates) -> None:
        chain_velocities(
            state.angles,
            state.rates,
            self.chain_model.joint,
            self.chain_model.root,
            state.velocity,
            state.rotation @ state.spin,
            out,
        )


def _finite(accelerations: Accelerations) -> Accelerations:
    if not np.isfinite(accelerations.qdd).all():
        raise SimulationError("the accelerations became infinite or undefined.")
    return accelerations


class SpringChain(Engine):
    """Chain whose hinges have springs towards straight and rotor inertias.

    Args:
        chain: The chain.
        material: Material of its joints.
        chain_model: Inertial parameters of the chain.
    """

    def __init__(self, chain: Chain, material: Material, chain_model: ChainModel) -> None:
        super().__init__(chain_model, material.stop_of(chain.module))
        hinges = len(chain.folded_rad)
        self.chain = chain
        self.root = chain_model.root
        self._rotor_inertias = np.full(hinges, float(material.armature))
        self._stiffness = np.full(hinges, float(material.stiffness))
        self._end_torque = np.zeros(3)

    def set_stiffness(self, stiffness: Array) -> None:
        """Set the stiffness of the springs of (J,) hinges."""
        self._stiffness = stiffness

    def set_rotor_inertias(self, inertias: Array) -> None:
        """Set the rotor inertias of (J,) hinges, module mass · pitch²."""
        self._rotor_inertias = inertias

    def free_accelerations(self, state: State, forces: Array) -> Acceleration:
        """Return the acceleration of a state without contacts, no hinge at its stop.

        ``place`` must have been called for the state.

        Args:
            state: The reduced state.
            forces: (n, 3) forces at the modules' centres, in the world frame.

        Raises:
            SimulationError: The accelerations are not finite.
        """
        return _reduced(state, self.unconstrained(state, self._loads(state, forces)), None)

    def _contact_accelerations(
        self, state: State, forces: Array, contacts: DetectedContacts | None
    ) -> Acceleration:
        accelerations = self.constrained(state, self._loads(state, forces), contacts)
        return _reduced(state, accelerations, contacts)

    def _loads(self, state: State, forces: Array) -> Loads:
        torques = -self._stiffness * state.angles
        return Loads(torques, self._rotor_inertias, forces, self._end_torque)


def _reduced(
    state: State, accelerations: Accelerations, contacts: DetectedContacts | None
) -> Acceleration:
    """Return accelerations with that of the root in its own frame, and figures of the contacts."""
    depths = np.zeros(0) if contacts is None else contacts.points.depths
    return Acceleration(
        hinges=accelerations.qdd,
        linear=accelerations.root[3:],
        angular=state.rotation.T @ accelerations.root[:3],
        contacts=len(depths),
        depth=float(depths.max()) if len(depths) else 0.0,
    )
