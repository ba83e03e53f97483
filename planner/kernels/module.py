"""A module as kernels take it: its joint and its hull, from ``planner.chain.module.Module``."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Joint(NamedTuple):
    """How a module's pose follows from the pose of the module before it, in pitches.

    Attributes:
        rigid_links: How many links at the start of a chain carry no joint.
        anchor: (3,) centre of the joint in the frame of the module before it.
        axes: (K, 3) hinge axes, outermost first.
        turn: (3, 3) fixed rotation from the joint's frame to the next module's frame.
        offset: (3,) centre of the next module seen from the joint, in the next module's frame.
    """

    rigid_links: int
    anchor: Array
    axes: Array
    turn: Array
    offset: Array


class Hull(NamedTuple):
    """The convex polyhedron that a module is at full size, about its centre, in pitches.

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
