"""Depth by which linked modules overlap during a motion, compiled: decision 0018.

The relative pose of two linked modules depends on the angles of their joint alone. The near face of
the next module faces a direction d of length 1; the module extends through that face by
h = max v·d − c, over its corners v in the joint's frame, with c the distance of the face. The
overlap is at most h. Between two frames the hinges turn evenly, by Δq: every v·d then stays within
|v| (Σ|Δq|)²/8 of linear interpolation, and h is at most the larger one of both ends plus as much.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL
from foldback.planner.kernels.clearance import pair_separation
from foldback.planner.kernels.kinematics import copy_vector
from foldback.planner.kernels.module import Hull, Joint

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class Link(NamedTuple):
    """A joint and the two hulls that it links.

    Attributes:
        joint: The joint.
        hull: Full-size hull of both modules.
        size: Scale of the hulls.
        face: (3,) unit normal of the next module's near face, in that module's frame.
        distance: Distance of that face from the joint in pitches.
    """

    joint: Joint
    hull: Hull
    size: float
    face: Array
    distance: float


class Overlap(NamedTuple):
    """The deepest overlap of a motion.

    Attributes:
        depth: Deepest overlap seen, in pitches; 0 if nothing overlaps.
        frame: Frame number of it; a half means halfway between two frames.
        joint: Number of the joint; −1 if nothing overlaps.
        bound: Upper bound of the overlap over the whole motion, in pitches.
    """

    depth: float
    frame: float
    joint: int
    bound: float


@njit(**INNER)
def _rotate_about(axis: Array, angle: float, vector: Array, out: Array) -> None:
    """Write a vector rotated about an axis of length 1 (Rodrigues); ``out`` may be ``vector``."""
    c, s = np.cos(angle), np.sin(angle)
    along = (axis[0] * vector[0] + axis[1] * vector[1] + axis[2] * vector[2]) * (1.0 - c)
    x = axis[1] * vector[2] - axis[2] * vector[1]
    y = axis[2] * vector[0] - axis[0] * vector[2]
    z = axis[0] * vector[1] - axis[1] * vector[0]
    out[0], out[1], out[2] = (
        c * vector[0] + s * x + along * axis[0],
        c * vector[1] + s * y + along * axis[1],
        c * vector[2] + s * z + along * axis[2],
    )


@njit(**INNER)
def _extension(link: Link, angles: Array, towards: Array) -> float:
    """Return h, by which the module extends through the near face of the next one, in pitches.

    ``towards`` (3,) receives d.
    """
    for r in range(3):
        towards[r] = 0.0
        for c in range(3):
            towards[r] += link.joint.turn[r, c] * link.face[c]
    for k in range(angles.shape[0] - 1, -1, -1):
        _rotate_about(link.joint.axes[k], angles[k], towards, towards)
    extent = -np.inf
    for v in range(link.hull.vertices.shape[0]):
        along = 0.0
        for r in range(3):
            along += (link.size * link.hull.vertices[v, r] - link.joint.anchor[r]) * towards[r]
        extent = max(extent, along)
    return extent - link.distance


@njit(**INNER)
def _overlap(link: Link, angles: Array) -> float:
    """Return the overlap of the two modules by separating axes, in pitches; below 0 if apart."""
    rotation = link.joint.turn.copy()
    column = np.empty(3)
    gap = np.zeros(3)
    for r in range(3):
        copy_vector(rotation[:, r], column)
        for k in range(angles.shape[0] - 1, -1, -1):
            _rotate_about(link.joint.axes[k], angles[k], column, column)
        copy_vector(column, rotation[:, r])
        for i in range(3):
            gap[i] += column[i] * link.joint.offset[r]
    gap += link.joint.anchor
    return -pair_separation(
        gap,
        np.eye(3),
        rotation,
        link.hull,
        link.size,
        np.inf,
    )


@njit(**KERNEL, nogil=True)
def deepest_overlap(
    link: Link, folded: Array, first: Ints, offsets: Ints, values: Array
) -> Overlap:
    """Find the deepest overlap of linked modules at all frames and halfway between them.

    Args:
        link: The joint and its hulls.
        folded: (J,) hinge angles before a window in radians; behind it they are 0.
        first: (F,) first hinge of each frame's window.
        offsets: (F + 1,) start of each window in ``values``.
        values: Angles of all windows in radians.
    """
    hinges = link.joint.axes.shape[0]
    frames = first.shape[0]
    longest = 0.0  # of |v|
    for v in range(link.hull.vertices.shape[0]):
        lever = link.size * link.hull.vertices[v] - link.joint.anchor
        longest = max(longest, np.sqrt((lever**2).sum()))
    towards = np.empty(3)
    start_angles, end_angles, halfway = np.empty(hinges), np.empty(hinges), np.empty(hinges)
    depth, frame, joint, bound = 0.0, 0.0, -1, 0.0
    for k in range(frames):
        to = min(k + 1, frames - 1)
        low = min(first[k], first[to])
        high = max(
            first[k] + offsets[k + 1] - offsets[k], first[to] + offsets[to + 1] - offsets[to]
        )
        for at_link in range(low // hinges, (high + hinges - 1) // hinges):
            turned = 0.0
            for a in range(hinges):
                hinge = at_link * hinges + a
                for end in range(2):
                    at = k if end == 0 else to
                    width = offsets[at + 1] - offsets[at]
                    if hinge < first[at]:
                        angle = folded[hinge]
                    elif hinge < first[at] + width:
                        angle = values[offsets[at] + hinge - first[at]]
                    else:
                        angle = 0.0
                    if end == 0:
                        start_angles[a] = angle
                    else:
                        end_angles[a] = angle
                halfway[a] = 0.5 * (start_angles[a] + end_angles[a])
                turned += abs(end_angles[a] - start_angles[a])
            begins, ends = (
                _extension(link, start_angles, towards),
                _extension(link, end_angles, towards),
            )
            bound = max(bound, max(begins, ends) + longest * turned**2 / 8.0)
            if begins > depth:
                overlap = _overlap(link, start_angles)
                if overlap > depth:
                    depth, frame, joint = overlap, float(k), at_link
            if to > k and _extension(link, halfway, towards) > depth:
                overlap = _overlap(link, halfway)
                if overlap > depth:
                    depth, frame, joint = overlap, k + 0.5, at_link
    return Overlap(depth, frame, joint, bound)
