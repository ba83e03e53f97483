"""Relief: material that linked modules must lack where they would overlap: decision 0018."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Flags
from foldback.planner.chain.module import Module
from foldback.planner.chain.polyhedron import Polyhedron

RELIEF_SAMPLES: Final = 64
"""Number of points along each side of a part at which its relief is sampled, to compute its
volume."""


def near_faces(module: Module, module_size: float) -> Array:
    """Return the (T,) distances of the next module's near face from each of the joints, in pitches.

    The face is across the line from the joint to the next module's centre. It may lie behind the
    joint; then its distance is negative.

    Args:
        module: The kind of module.
        module_size: Module size as a fraction of the pitch.
    """
    faces: list[float] = []
    for before, offset in zip(module.joint_holders.tolist(), module.joint.offset, strict=True):
        distance = float(np.linalg.norm(offset))
        corners = module.piece(before + 1).corners
        faces.append(distance + module_size * float((corners @ offset).min()) / distance)
    return np.array(faces)


def relief_radius(module: Module, module_size: float) -> float | None:
    """Return the largest ``reach`` of the points of a real module, in pitches.

    Points that reach farther would lie in the next module at some angles of the joint. None if
    linked modules are checked like all others, so that no volume has to be cut away, if the next
    module surrounds the joint, so that nothing else could remain, or if two hinges are not at right
    angles to the link.

    Args:
        module: The kind of module.
        module_size: Module size as a fraction of the pitch.
    """
    is_universal = any(piece.joint_kind == "universal" for piece in module.pieces)
    if module.apart < 2 or (is_universal and not module.has_universal_joints):
        return None
    nearest = float(near_faces(module, module_size).min())
    return nearest if nearest > 0.0 else None


@lru_cache(maxsize=64)
def relief_share(module: Module, module_size: float) -> float:
    """Return the fraction of their volume that real modules lack by ``relief_radius``.

    Args:
        module: The kind of module.
        module_size: Module size as a fraction of the pitch.
    """
    radius = relief_radius(module, module_size)
    if radius is None:
        return 0.0
    lacking = [
        reach(module, points, row) > radius
        for row, before in enumerate(module.joint_holders.tolist())
        for points in [_points_of(module.piece(before).parts, module_size)]
    ]
    return round(float(np.mean([share.mean() for share in lacking])), 3)


def reach(module: Module, points: Array, row: int = 0) -> Array:
    """Return the reach of points from the joint over all directions of the next module.

    In front of a universal joint that is their distance from it, behind it that from the line of
    the link, and more there by what the joint turns beyond a right angle.

    Args:
        module: The kind of module, with a hinge or a universal joint in each link.
        points: (P, 3) in the frame of the module before the joint, in pitches.
        row: Row of the joint.

    Returns:
        (P,): the largest p · d over all directions d of the joint's range.
    """
    joint = module.joint
    outward = joint.turn[row] @ joint.offset[row]
    outward = outward / np.linalg.norm(outward)
    p, axes = points - joint.anchor[row], joint.axes[row]
    along, sideways, up = p @ outward, p @ np.cross(axes[0], outward), p @ axes[0]
    if len(axes) == 1:
        # d = R(axis, a) n keeps its part along the axis.
        rise = float(axes[0] @ outward)
        low, high = module.stops_behind(int(module.joint_holders[row]))[0]
        return up * rise + _largest_within(along - up * rise, sideways, float(low), float(high))
    # d = R(axis_1, a) R(axis_2, b) n, and the three directions are at right angles.
    limit = module.largest_angle_rad
    farthest = _largest_projection(along, sideways, limit)
    nearest = -_largest_projection(-along, sideways, limit)
    return np.maximum(
        _largest_projection(farthest, up, limit), _largest_projection(nearest, up, limit)
    )


def _largest_projection(along: Array, across: Array, limit: float) -> Array:
    """Return the largest of along · cos t + across · sin t over all |t| ≤ limit."""
    bent = along * np.cos(limit) + np.abs(across) * np.sin(limit)
    within = np.arctan2(np.abs(across), along) <= limit
    return np.where(within, np.hypot(along, across), bent)


def _largest_within(along: Array, across: Array, low: float, high: float) -> Array:
    """Return the largest of along · cos t + across · sin t over all t from low to high."""
    ends = [along * np.cos(t) + across * np.sin(t) for t in (low, high)]
    peak = np.arctan2(across, along)
    turns = np.ceil((low - peak) / (2.0 * np.pi))
    within = peak + 2.0 * np.pi * turns <= high
    return np.where(within, np.hypot(along, across), np.maximum(*ends))


def _points_of(parts: tuple[Polyhedron, ...], module_size: float) -> Array:
    """Return (P, 3) evenly spaced points in the parts of a piece at a size."""
    corners = np.concatenate([part.corners for part in parts]) * module_size
    sides = [
        low + (np.arange(RELIEF_SAMPLES) + 0.5) * (high - low) / RELIEF_SAMPLES
        for low, high in zip(corners.min(axis=0), corners.max(axis=0), strict=True)
    ]
    points = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = np.zeros(len(points), dtype=bool)
    for part in parts:
        inside |= _is_inside(part, points / module_size)
    return points[inside]


def _is_inside(part: Polyhedron, points: Array) -> Flags:
    heights = part.corners @ part.face_normals.T
    reached = points @ part.face_normals.T
    return ((reached >= heights.min(axis=0)) & (reached <= heights.max(axis=0))).all(axis=1)
