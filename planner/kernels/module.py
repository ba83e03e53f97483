"""A module as kernels take it, and the state of all modules of a chain.

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


class ReducedAcceleration(NamedTuple):
    """Accelerations of the generalised coordinates of a free chain.

    Attributes:
        qdd: (J,) hinge accelerations q̈, in rad/s².
        linear: (3,) acceleration of the root in the world frame.
        angular: (3,) angular acceleration α of the root in its own frame.
    """

    qdd: Array
    linear: Array
    angular: Array
