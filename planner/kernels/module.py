"""A module and a chain as kernels take them, and the state of all modules of a chain.

Lengths are in pitches, masses in module masses, times in seconds and angles in radians.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Joint(NamedTuple):
    """Pose of a module relative to the module before it, in pitches.

    Attributes:
        rigid_links: Number of links without hinges at the start of a chain.
        anchor: (3,) centre of the joint in the frame of the module before it.
        axes: (K, 3) unit hinge axes, outermost first.
        turn: (3, 3) fixed rotation from the joint's frame to the next module's frame.
        offset: (3,) centre of the next module seen from the joint, in the next module's frame.
    """

    rigid_links: int
    anchor: Array
    axes: Array
    turn: Array
    offset: Array


class Hull(NamedTuple):
    """Convex polyhedron of a module at full size, about its centre, in pitches.

    Attributes:
        vertices: (V, 3) corners.
        normals: (A, 3) unit normals of its faces, one of each parallel pair.
        edges: (E, 3) unit directions of its edges, one of each parallel set.
        radius: Distance from the centre to the farthest corner.
    """

    vertices: Array
    normals: Array
    edges: Array
    radius: float


class ModuleStates(NamedTuple):
    """Poses and velocities of all n modules, in the world frame.

    Attributes:
        positions: (n, 3) centres, in pitches.
        rotations: (n, 3, 3) orientations.
        velocities: (n, 3) velocities of the centres, in pitches per second.
        angular_velocities: (n, 3) ω, in rad/s.
    """

    positions: Array
    rotations: Array
    velocities: Array
    angular_velocities: Array

    @classmethod
    def empty(cls, modules: int) -> ModuleStates:
        """Return uninitialised arrays for a number of modules."""
        return cls(
            np.empty((modules, 3)),
            np.empty((modules, 3, 3)),
            np.empty((modules, 3)),
            np.empty((modules, 3)),
        )


class ReducedState(NamedTuple):
    """Generalised coordinates of a free chain and their velocities.

    Attributes:
        q: (J,) hinge angles, in rad.
        qd: (J,) hinge rates q̇, in rad/s.
        position: (3,) centre of the root, in pitches.
        rotation: (3, 3) orientation of the root.
        velocity: (3,) velocity of the root in the world frame.
        angular_velocity: (3,) ω of the root in its own frame.
    """

    q: Array
    qd: Array
    position: Array
    rotation: Array
    velocity: Array
    angular_velocity: Array


class Lumps(NamedTuple):
    """Rigid bodies fixed to the first and to the last module of a chain, of mass 0 for none.

    Attributes:
        masses: (2,) masses, in module masses.
        centres: (2, 3) centres of mass, in the frames of the modules, in pitches.
        axes: (2, 3, 3) principal axes of inertia as columns, in the frames of the modules.
        moments: (2, 3) principal moments about the centres of mass, in module mass · pitch².
    """

    masses: Array
    centres: Array
    axes: Array
    moments: Array

    @classmethod
    def none(cls) -> Lumps:
        """Return lumps of mass 0."""
        return cls(np.zeros(2), np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)))


class ChainModel(NamedTuple):
    """Inertial parameters of a chain of n modules.

    Attributes:
        joint: The module's joint.
        masses: (n,) masses of the modules, in module masses.
        inertia: (3,) principal moments of a module of mass 1 about its centre, in pitch².
        lumps: Rigid bodies at both ends of the chain.
        fixed_base: True if module 0 is held.
        root: Index of the module whose motion is part of the reduced state.
    """

    joint: Joint
    masses: Array
    inertia: Array
    lumps: Lumps
    fixed_base: bool
    root: int
