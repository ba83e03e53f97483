"""Ten meshes with thin parts, walls, gaps and tunnels, which a chain of few modules may lose."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
import trimesh

from bench.held_out_meshes import ball, rod, tube
from bench.meshes import Mesh, box, joined, revolved


def spring() -> Mesh:
    t = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    # One tube all the way round: four turns up, and back through the middle.
    turns = np.clip(t / (1.6 * np.pi), 0.0, 1.0)
    clipped = np.clip((t - 1.6 * np.pi) / (0.4 * np.pi), 0.0, 1.0)
    radius = 4.0 * (1.0 - np.sin(np.pi * clipped))
    angle = 8.0 * np.pi * turns
    curve = np.column_stack(
        [radius * np.cos(angle), radius * np.sin(angle), 12.0 * turns - 12.0 * clipped]
    )
    return tube(curve, np.full(len(t), 0.8))


def rings() -> Mesh:
    """Return three rings in a row that touch where they pass through each other."""
    links: list[Mesh] = []
    for k in range(3):
        link = trimesh.creation.torus(3.0, 0.9)
        link.apply_transform(trimesh.transformations.rotation_matrix(k * np.pi / 2, [1, 0, 0]))
        link.apply_translation([4.8 * k, 0.0, 0.0])
        links.append(link)
    return joined(*links)


def vase() -> Mesh:
    heights = np.linspace(0, 12, 40)
    radii = 3.0 + 1.5 * np.sin(heights / 2.2)
    outer = [(float(r), float(z)) for r, z in zip(radii, heights, strict=True)]
    inner = [(float(r) - 0.7, float(z)) for r, z in zip(radii, heights, strict=True) if z > 0.8]
    return revolved([(0, 0), *outer, *inner[::-1], (0, 0.8)])


def shells() -> Mesh:
    """Return a bowl within a bowl on one foot."""

    def shell(radius: float) -> Mesh:
        angles = np.linspace(0, np.pi / 2, 20)
        outer = [(radius * np.sin(t), -radius * np.cos(t)) for t in angles]
        inner = [((radius - 0.9) * np.sin(t), -(radius - 0.9) * np.cos(t)) for t in angles[::-1]]
        return revolved([*outer, *inner])

    return joined(shell(6.0), shell(3.5), rod((0, 0, -7.5), (0, 0, -3.0), 1.0))


def comb() -> Mesh:
    teeth = [box((0.9, 1.2, 6.0), (2.0 * k - 8.0, 0, -3.5)) for k in range(9)]
    return joined(box((17.5, 1.2, 2.0), (0, 0, 0)), *teeth)


def letter_a() -> Mesh:
    return joined(
        rod((-4, 0, 0), (0, 0, 11), 0.9),
        rod((4, 0, 0), (0, 0, 11), 0.9),
        rod((-2.5, 0, 4), (2.5, 0, 4), 0.8),
    )


def stairs() -> Mesh:
    return joined(*(box((1.6, 5.0, 0.7), (1.3 * k, 0, 0.65 * k)) for k in range(10)))


def hourglass() -> Mesh:
    glass = revolved([(0, 0), (3.4, 0), (3.2, 2.5), (0.7, 5.5), (3.2, 8.5), (3.4, 11), (0, 11)])
    posts = [
        rod((4.2 * np.cos(t), 4.2 * np.sin(t), 0), (4.2 * np.cos(t), 4.2 * np.sin(t), 11), 0.5)
        for t in np.linspace(0, 2 * np.pi, 3, endpoint=False)
    ]
    plates = [revolved([(0, z), (5, z), (5, z + 0.9), (0, z + 0.9)]) for z in (-0.9, 11.0)]
    return joined(glass, *posts, *plates)


def teapot() -> Mesh:
    profile = [(3.8 * np.sin(t), 3.0 - 3.0 * np.cos(t)) for t in np.linspace(0, 2.6, 24)]
    handle = trimesh.creation.torus(1.9, 0.5)
    handle.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    handle.apply_translation([-4.2, 0, 3.2])
    spout = [rod((3.0, 0, 2.0), (5.2, 0, 3.2), 0.8), rod((5.2, 0, 3.2), (6.2, 0, 5.2), 0.6)]
    lid = ball(0.8, (0, 0, 6.2))
    return joined(revolved([*profile, (0, profile[-1][1])]), handle, *spout, lid)


def wire_cube() -> Mesh:
    bars: list[Mesh] = []
    for axis, (a, b) in product(range(3), product((-5.0, 5.0), repeat=2)):
        size, at = np.full(3, 1.6), np.zeros(3)
        size[axis] = 11.6
        at[[k for k in range(3) if k != axis]] = a, b
        bars.append(box(size.tolist(), (float(at[0]), float(at[1]), float(at[2]))))
    return joined(*bars)


THIN: dict[str, Callable[[], Mesh]] = {
    "spring": spring,
    "rings": rings,
    "vase": vase,
    "shells": shells,
    "comb": comb,
    "letter A": letter_a,
    "stairs": stairs,
    "hourglass": hourglass,
    "teapot": teapot,
    "wire cube": wire_cube,
}


def thin_mug(wall: float = 0.06) -> Mesh:
    cup = trimesh.creation.annulus(1.0 - wall, 1.0, 2.2, sections=64)
    bottom = trimesh.creation.cylinder(1.0 - wall / 2, wall, sections=64)
    bottom.apply_translation([0, 0, -1.1 + wall / 2])
    handle = [box((0.8, 0.24, 0.24), (1.3, 0, z)) for z in (-0.6, 0.6)]
    return joined(cup, bottom, *handle, box((0.24, 0.24, 1.44), (1.6, 0, 0)))


def lampshade() -> Mesh:
    return revolved([(2.0, 0), (1.0, 2.2), (0.92, 2.2), (1.92, 0), (2.0, 0)])


def thin_bowl() -> Mesh:
    angles = np.linspace(0, np.pi / 2, 24)
    outer = [(3.0 * np.sin(t), -3.0 * np.cos(t)) for t in angles]
    inner = [(2.85 * np.sin(t), -2.85 * np.cos(t)) for t in angles[::-1]]
    return revolved([*outer, *inner])


def open_box() -> Mesh:
    ends = [box((0.15, 3, 2.5), (x, 0, 1.25)) for x in (-1.925, 1.925)]
    sides = [box((4, 0.15, 2.5), (0, y, 1.25)) for y in (-1.425, 1.425)]
    return joined(box((4, 3, 0.15), (0, 0, 0.075)), *ends, *sides)


WALLS: dict[str, Callable[[], Mesh]] = {
    "thin mug": thin_mug,
    "lampshade": lampshade,
    "thin bowl": thin_bowl,
    "open box": open_box,
}
"""Four meshes whose walls are a sixth to a third of a module thick with 160 modules."""
