"""Orientations in which a solid may be laid on the lattice."""

from __future__ import annotations

from itertools import permutations, product
from typing import Any, cast

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.shapes.solid import Solid


def candidates(solid: Solid, rng: np.random.Generator) -> tuple[Array, ...]:
    """Return rotations to try: identity, main axes, eighths of a turn and random ones.

    Rotations that differ by a symmetry of the lattice count as the same.
    """
    rotations: list[Array] = [np.eye(3)]
    turns = [main_axes(solid)]
    turns += [about_axis(axis, np.pi / 4) for axis in (2, 0, 1)]
    turns += [_random(rng) for _ in range(3)]
    for rotation in turns:
        nearest = _nearest_to_upright(rotation)
        if all(_apart(nearest, earlier) > 0.05 for earlier in rotations):  # rad
            rotations.append(nearest)
    return tuple(rotations)


def main_axes(solid: Solid) -> Array:
    """Return the (3, 3) rotation that lays the main axes of a solid along x, y and z."""
    points = solid.vertices[:: max(1, len(solid.vertices) // 20_000)]
    spread = np.cov((points - points.mean(axis=0)).T / solid.extents.max())
    _, axes = np.linalg.eigh(spread)
    rotation = axes.T
    return rotation if np.linalg.det(rotation) > 0 else -rotation


def about_axis(axis: int, angle_rad: float) -> Array:
    """Return the (3, 3) rotation by an angle about an axis, 0 to 2."""
    rotation = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation[i, i] = rotation[j, j] = np.cos(angle_rad)
    rotation[i, j], rotation[j, i] = -np.sin(angle_rad), np.sin(angle_rad)
    return rotation


def _random(rng: np.random.Generator) -> Array:
    matrix, triangular = np.linalg.qr(rng.normal(size=(3, 3)))
    matrix = cast("Array", matrix * np.sign(np.diag(triangular)))
    return matrix if np.linalg.det(matrix) > 0 else -matrix


def _symmetries() -> list[Array]:
    symmetries: list[Array] = []
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        matrix: Any = np.zeros((3, 3))
        matrix[range(3), order] = signs
        if np.linalg.det(matrix) > 0:
            symmetries.append(matrix)
    return symmetries


def _nearest_to_upright(rotation: Array) -> Array:
    """Return the smallest rotation that is equivalent under the symmetries of the lattice."""
    return max((s @ rotation for s in _symmetries()), key=lambda r: float(np.trace(r)))


def _apart(a: Array, b: Array) -> float:
    """Return the smallest angle between two rotations under the lattice's symmetries, rad."""
    trace = max(float(np.trace(s @ a @ b.T)) for s in _symmetries())
    return float(np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0)))
