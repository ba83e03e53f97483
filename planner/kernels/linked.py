"""How far linked modules of full size overlap during a motion, compiled.

How two linked modules lie depends on the angles of their joint alone. The next module's near face
looks along a direction d of length 1; the module reaches through that face by h = max v·d − c, over
its corners v as seen from the joint, with c the distance of the face. The overlap is never more
than h. Between two frames the hinges turn evenly, by Δq: every v·d then stays within |v| (Σ|Δq|)²/8
of the line through its values at both ends, and h is at most the larger of its two plus as much.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import INNER, KERNEL
from planner.kernels.clearance import pair_separation
from planner.kernels.kinematics import copy_vector
from planner.kernels.module import Hull, Joint

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class Link(NamedTuple):
    """A joint and the two full-size hulls that it links.

    Attributes:
        joint: Between the two.
        hull: Of both.
        size: Scale of the hulls.
        face: (3,) where the next module's near face looks in its own frame, and ...
        distance: ... how far from the joint that face is.
    """

    joint: Joint
    hull: Hull
    size: float
    face: Array
    distance: float


class Overlap(NamedTuple):
    """The deepest overlap found, when that is (a half: between two frames), which joint; a bound.

    The joint is −1 when nothing overlaps.
    """

    depth: float
    frame: float
    joint: int
    bound: float


@njit(**INNER)
def _turned(axis: Array, angle: float, vector: Array, out: Array) -> None:
    """Writes a vector turned about an axis of length 1."""
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
def _reach(link: Link, angles: Array, towards: Array) -> float:
    """How far the module reaches through the next one's near face."""
    for r in range(3):
        towards[r] = 0.0
        for c in range(3):
            towards[r] += link.joint.turn[r, c] * link.face[c]
    for k in range(angles.shape[0] - 1, -1, -1):
        _turned(link.joint.axes[k], angles[k], towards, towards)
    most = -np.inf
    for v in range(link.hull.vertices.shape[0]):
        along = 0.0
        for r in range(3):
            along += (link.size * link.hull.vertices[v, r] - link.joint.anchor[r]) * towards[r]
        most = max(most, along)
    return most - link.distance


@njit(**INNER)
def _depth(link: Link, angles: Array) -> float:
    """How deep the two modules overlap, by separating axes; below 0 when they are apart."""
    rotation = link.joint.turn.copy()
    column = np.empty(3)
    gap = np.zeros(3)
    for r in range(3):
        copy_vector(rotation[:, r], column)
        for k in range(angles.shape[0] - 1, -1, -1):
            _turned(link.joint.axes[k], angles[k], column, column)
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
    """The deepest overlap of linked modules over the frames of a motion and halfway between them.

    Args:
        link: What is linked, and how.
        folded: (J,) hinge angles before a window; behind it they are 0.
        first: (F,) hinges at which the frames' windows begin.
        offsets: (F + 1,) where each window begins in ``values``.
        values: The angles of all windows.
    """
    hinges = link.joint.axes.shape[0]
    frames = first.shape[0]
    longest = 0.0
    for v in range(link.hull.vertices.shape[0]):
        away = link.size * link.hull.vertices[v] - link.joint.anchor
        longest = max(longest, np.sqrt((away**2).sum()))
    towards = np.empty(3)
    here, there, halfway = np.empty(hinges), np.empty(hinges), np.empty(hinges)
    depth, frame, who, bound = 0.0, 0.0, -1, 0.0
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
                        here[a] = angle
                    else:
                        there[a] = angle
                halfway[a] = 0.5 * (here[a] + there[a])
                turned += abs(there[a] - here[a])
            begins, ends = _reach(link, here, towards), _reach(link, there, towards)
            bound = max(bound, max(begins, ends) + longest * turned**2 / 8.0)
            if begins > depth:
                found = _depth(link, here)
                if found > depth:
                    depth, frame, who = found, float(k), at_link
            if to > k and _reach(link, halfway, towards) > depth:
                found = _depth(link, halfway)
                if found > depth:
                    depth, frame, who = found, k + 0.5, at_link
    return Overlap(depth, frame, who, bound)
