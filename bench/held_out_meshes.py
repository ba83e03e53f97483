"""Ten more meshes of other forms, which were not used to tune the voxeliser."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import trimesh
from numpy.typing import NDArray

from bench.meshes import Mesh, box, joined, revolved

Array = NDArray[np.float64]


def ball(radius: float, at: tuple[float, float, float], stretch: float = 1.0) -> Mesh:
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    mesh.apply_scale([1.0, 1.0, stretch])
    mesh.apply_translation(at)
    return mesh


def rod(a: tuple[float, float, float], b: tuple[float, float, float], radius: float) -> Mesh:
    return trimesh.creation.cylinder(radius=radius, segment=[a, b], sections=32)


def tube(middles: Array, radius: Array, *, ring: int = 24) -> Mesh:
    """Return a tube around a closed curve (n, 3), with the radii (n,)."""
    ahead = np.roll(middles, -1, axis=0) - np.roll(middles, 1, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    side = np.cross(ahead, middles - middles.mean(axis=0) + [0.0, 0.0, 5.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, ahead)
    turns = np.linspace(0, 2 * np.pi, ring, endpoint=False)
    rims = side[:, None] * np.cos(turns)[None, :, None] + up[:, None] * np.sin(turns)[None, :, None]
    points = middles[:, None] + radius[:, None, None] * rims
    n = len(middles)
    i, j = np.meshgrid(np.arange(n), np.arange(ring), indexing="ij")
    a, b = i * ring + j, ((i + 1) % n) * ring + j
    c, d = ((i + 1) % n) * ring + (j + 1) % ring, i * ring + (j + 1) % ring
    faces = np.concatenate(
        [np.stack([a, b, c], axis=-1).reshape(-1, 3), np.stack([a, c, d], axis=-1).reshape(-1, 3)]
    )
    mesh = Mesh(points.reshape(-1, 3), faces)
    if mesh.volume < 0:
        mesh.invert()
    return mesh


def trefoil() -> Mesh:
    t = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    curve = np.column_stack(
        [np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -1.4 * np.sin(3 * t)]
    )
    return tube(2.0 * curve, np.full(len(t), 1.1))


def wavy_ring() -> Mesh:
    t = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    curve = np.column_stack([5 * np.cos(t), 4 * np.sin(t), 1.2 * np.sin(2 * t)])
    return tube(curve, 1.4 + 0.5 * np.cos(3 * t))


def chair() -> Mesh:
    legs = [box((1.4, 1.4, 5.0), (x, y, 2.5)) for x in (-2.8, 2.8) for y in (-2.8, 2.8)]
    return joined(*legs, box((7, 7, 1.4), (0, 0, 5.5)), box((7, 1.4, 7), (0, 2.8, 9.0)))


def bone() -> Mesh:
    ends = [ball(1.5, (x, y, 0)) for x in (-5.0, 5.0) for y in (-1.1, 1.1)]
    return joined(rod((-5, 0, 0), (5, 0, 0), 1.1), *ends)


def rocket() -> Mesh:
    nose = [(1.6 * np.sqrt(max(0.0, 1 - s * s)), 9.0 + 4.0 * s) for s in np.linspace(0, 1, 12)]
    body = revolved([(0, 0), (1.3, 0), (1.8, 3.0), *nose])
    fins = [box((2.6, 0.9, 3.0), (2.0, 0, 1.8)) for _ in range(3)]
    for k, fin in enumerate(fins):
        turn = 2 * np.pi * k / 3
        fin.apply_transform(trimesh.transformations.rotation_matrix(turn, [0, 0, 1]))
    return joined(body, *fins)


def rabbit() -> Mesh:
    return joined(
        ball(3.2, (0, 0, 0), 0.9),
        ball(2.0, (2.6, 0, 2.8)),
        ball(0.8, (2.2, 0.9, 5.6), 2.2),
        ball(0.8, (2.2, -0.9, 5.6), 2.2),
        ball(1.0, (-3.3, 0, 0.2)),
        *(ball(1.1, (x, y, -2.6)) for x in (-1.6, 2.0) for y in (-1.4, 1.4)),
    )


def hammer() -> Mesh:
    head = joined(box((6, 2.4, 2.4), (0, 0, 10)), rod((3, 0, 10), (4.5, 0, 10), 1.6))
    return joined(head, rod((0, 0, 0), (0, 0, 10), 0.9))


def bottle() -> Mesh:
    return revolved(
        [(0, 0), (2.6, 0), (2.8, 0.4), (2.8, 6), (2.3, 7.4), (1.1, 8.6), (1.1, 11), (0, 11)]
    )


def crossing() -> Mesh:
    return joined(
        rod((-6, 0, 0), (6, 0, 0), 1.5),
        rod((0, -6, 0), (0, 6, 0), 1.5),
        rod((0, 0, 0), (0, 0, 6), 1.5),
    )


def house() -> Mesh:
    wall = np.array([(-4, 0), (4, 0), (4, 4), (0, 7.5), (-4, 4)], dtype=float)
    points = np.vstack([np.insert(wall, 1, y, axis=1) for y in (-3.0, 3.0)])
    roofed = trimesh.convex.convex_hull(points)
    return joined(roofed, box((1.6, 1.6, 4.0), (2.4, 1.0, 5.5)))


HELD_OUT: dict[str, Callable[[], Mesh]] = {
    "trefoil": trefoil,
    "wavy ring": wavy_ring,
    "chair": chair,
    "bone": bone,
    "rocket": rocket,
    "rabbit": rabbit,
    "hammer": hammer,
    "bottle": bottle,
    "crossing": crossing,
    "house": house,
}
