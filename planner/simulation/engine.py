"""Engine: forward dynamics of a chain by an articulated-body pass, with contacts and stops.

The chain floats, or its module 0 is held. Rigid lumps may be fixed to both of its ends: a folded
core, a straight tail. Each hinge has a torque and a rotor inertia; one at its stop is locked.
MuJoCo finds the contacts, whose forces follow from a system of their own
(``planner/core/contact_forces.cpp``). The time of a step is proportional to the number of modules.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.core import (
    chain_poses,
    chain_velocities,
    constrained_accelerations,
)
from foldback.planner.core.structures import (
    MAX_DIRECT_CONTACTS,
    NO_CONTACTS,
    Accelerations,
    ArticulatedBodies,
    ChainModel,
    ContactModel,
    ControlLimits,
    DetectedContacts,
    Loads,
    Lumps,
    ModuleStates,
    PairContacts,
    SteppedChain,
)
from foldback.planner.errors import SimulationError
from foldback.planner.simulation.mujoco_models import Material
from foldback.planner.simulation.reduced_state import Acceleration, State


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
        masses: (n,) masses of the modules; those of their pieces by default. Inertias are in
            proportion.
        lumps: Rigid bodies at both ends; none by default.
    """
    return ChainModel(
        chain.module.joint,
        chain.module.masses(len(chain)) if masses is None else masses,
        chain.module.moments,
        Lumps.none() if lumps is None else lumps,
        fixed_base,
        root,
    )


def found_contacts(data: Any, module_of_geom: Ints) -> PairContacts | None:
    """Return the contacts of a collision that MuJoCo has just computed; None if there are none.

    Args:
        data: Data of MuJoCo.
        module_of_geom: Index of the module that each geom belongs to.
    """
    if not data.ncon:
        return None
    contact = data.contact
    return PairContacts(
        module_of_geom[contact.geom],
        np.ascontiguousarray(contact.frame[:, :3]),
        np.ascontiguousarray(contact.pos),
        -contact.dist,
    )


def detected_contacts(model: Any, data: Any, module_of_geom: Ints) -> DetectedContacts | None:
    """Return the contacts of a collision, see ``found_contacts``, with their stiffness."""
    if (points := found_contacts(data, module_of_geom)) is None:
        return None
    solref = data.contact.solref[0]
    time_constant = max(float(solref[0]), 2.0 * model.opt.timestep)
    solimp = data.contact.solimp[0]
    return DetectedContacts(
        points, ContactModel(time_constant, float(solref[1]), solimp, MAX_DIRECT_CONTACTS)
    )


class Engine:
    """Chain of rigid modules on hinges, and its accelerations under forces.

    Attributes:
        chain_model: Inertial parameters of the chain.
        modules: Poses and velocities of all modules, as placed last.
        positions, rotations, velocities, spins: Arrays of ``modules``.

    Args:
        chain_model: Inertial parameters of the chain.
        stops: (J, 2) smallest and largest angle of each hinge, rad; infinite for none.
        modules: Arrays for poses and velocities; new ones by default.
    """

    def __init__(
        self, chain_model: ChainModel, stops: Array, modules: ModuleStates | None = None
    ) -> None:
        self.chain_model = chain_model
        self.stops = stops
        n, hinges = len(self.chain_model.masses), self.chain_model.joint.hinges
        self.modules = ModuleStates.empty(n) if modules is None else modules
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
        accelerations = Accelerations(np.empty_like(state.angles), np.empty(6))
        if not constrained_accelerations(
            self.chain_model,
            state.reduced,
            loads,
            self.modules,
            NO_CONTACTS if contacts is None else contacts,
            self.stops,
            self._aba,
            accelerations,
        ):
            raise SimulationError("the accelerations became infinite or undefined.")
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


class SpringChain(Engine):
    """Chain whose hinges have springs towards straight and rotor inertias.

    Args:
        chain: The chain.
        material: Material of its joints.
        chain_model: Inertial parameters of the chain.
    """

    def __init__(self, chain: Chain, material: Material, chain_model: ChainModel) -> None:
        super().__init__(chain_model, chain.stops_rad(material.stops_early_rad))
        hinges = len(chain.folded_rad)
        self.chain = chain
        self.root = chain_model.root
        self.rotor_inertias = np.full(hinges, float(material.armature))
        """(J,) rotor inertias of the hinges, module mass · pitch²."""
        self.stiffness = np.full(hinges, float(material.stiffness))
        """(J,) stiffness of the hinges' springs."""

    def set_stiffness(self, stiffness: Array) -> None:
        """Set the stiffness of the springs of (J,) hinges."""
        self.stiffness = stiffness

    def set_rotor_inertias(self, inertias: Array) -> None:
        """Set the rotor inertias of (J,) hinges, module mass · pitch²."""
        self.rotor_inertias = inertias

    def stepped_chain(self, contact_model: ContactModel, control: ControlLimits) -> SteppedChain:
        """Return the chain as kernels that make steps take it."""
        return SteppedChain(
            self.chain_model, self.rotor_inertias, self.stops, contact_model, control
        )

    def free_accelerations(self, state: State, forces: Array) -> Acceleration:
        """Return the acceleration of a state without contacts, no hinge at its stop.

        ``place`` must have been called for the state.

        Args:
            state: The reduced state.
            forces: (n, 3) forces at the modules' centres, in the world frame.

        Raises:
            SimulationError: The accelerations are not finite.
        """
        return self.contact_accelerations(state, forces, None)

    def contact_accelerations(
        self, state: State, forces: Array, contacts: DetectedContacts | None
    ) -> Acceleration:
        """Return the acceleration of a placed state under contacts, see ``free_accelerations``."""
        accelerations = self.constrained(state, self._loads(state, forces), contacts)
        return _reduced(state, accelerations, contacts)

    def _loads(self, state: State, forces: Array) -> Loads:
        torques = -self.stiffness * state.angles
        return Loads(torques, self.rotor_inertias, forces, np.zeros(3))


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
