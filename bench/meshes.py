"""Voxelisation: overlap of cells and solid, and the cost from a large mesh file to a path."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from bench.command import watched
from bench.sections import Section
from foldback.planner.shapes.solid import Solid
from foldback.planner.shapes.voxelise import voxelise

MESH_CELLS = 1000
"""Number of cells that is requested when the benchmark turns each triangle mesh into cells and
measures their overlap with the solid."""
MIN_MEAN_IOU = 0.85
"""Target of the benchmark: mean intersection over union (IoU) of the cells and the solid that they
approximate, over the ten meshes of a set; 1 is a perfect match. Below it the target is reported as
not met."""
MAX_LARGE_MESH_S = 3.0
"""Target of the benchmark: the command that turns a mesh of 100 000 triangles into a path takes
less wall time than this, in s, with the start of the process. At or above it the target is reported
as not met."""
MAX_LARGE_MESH_MIB = 500.0
"""Target of the benchmark: the command that turns a mesh of 100 000 triangles into a path takes
less memory than this, in MiB. At or above it the target is reported as not met."""

Mesh = trimesh.Trimesh


def joined(*parts: Mesh) -> Mesh:
    return trimesh.util.concatenate(list(parts))


def box(size: Sequence[float], at: Sequence[float]) -> Mesh:
    mesh = trimesh.creation.box(size)
    mesh.apply_translation(at)
    return mesh


def revolved(profile: Sequence[tuple[float, float]]) -> Mesh:
    return trimesh.creation.revolve(np.array(profile, dtype=float), sections=64)


def extruded(radii: NDArray[np.float64]) -> Mesh:
    """Return a prism of height 4 over a star-shaped polygon, given by its radii."""
    turns = np.linspace(0, 2 * np.pi, len(radii), endpoint=False)
    rim = np.column_stack([radii * np.cos(turns), radii * np.sin(turns), np.zeros(len(radii))])
    up = [0.0, 0.0, 4.0]
    points = np.vstack([rim, rim + up, [[0, 0, 0], up]])
    n = len(radii)
    current, ahead = np.arange(n), (np.arange(n) + 1) % n
    faces = np.vstack(
        [
            np.column_stack([current, ahead, ahead + n]),
            np.column_stack([current, ahead + n, current + n]),
            np.column_stack([ahead, current, np.full(n, 2 * n)]),
            np.column_stack([current + n, ahead + n, np.full(n, 2 * n + 1)]),
        ]
    )
    return Mesh(points, faces)


def blob(subdivisions: int = 4) -> Mesh:
    """Return a smooth body with a head and two ears."""
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    way = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    radius = np.ones(len(way))
    for bump, height, wide in (
        ((0.6, 0.0, 0.8), 0.7, 0.35),
        ((0.3, 0.4, 0.87), 0.6, 0.2),
        ((0.3, -0.4, 0.87), 0.6, 0.2),
        ((-1.0, 0.0, -0.1), 0.3, 0.3),
    ):
        distance = np.linalg.norm(way - np.array(bump) / np.linalg.norm(bump), axis=1)
        radius += height * np.exp(-((distance / wide) ** 2))
    mesh.vertices = way * radius[:, None]
    return mesh


def gear() -> Mesh:
    teeth = np.tile(np.repeat([10.0, 8.0], 8), 12)
    return extruded(teeth)


def star() -> Mesh:
    ways = np.linspace(0, 10, 200, endpoint=False) % 2
    return extruded(4.0 + 5.0 * np.abs(ways - 1.0))


def pawn() -> Mesh:
    ball = [(1.1 * np.sin(t), 5.6 - 1.1 * np.cos(t)) for t in np.linspace(0.6, np.pi, 16)]
    foot = [(0, 0), (2, 0), (2, 0.8), (1.3, 1.3), (0.9, 2.5), (0.7, 4.2), (1.3, 4.4), (0.7, 4.7)]
    return revolved([*foot, *ball[:-1], (0, 6.7)])


def mug() -> Mesh:
    cup = revolved([(0, 0), (4, 0), (4, 9), (3, 9), (3, 1), (0, 1)])
    handle = trimesh.creation.torus(2.0, 0.6)
    handle.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    handle.apply_translation([5.0, 0, 4.5])
    return joined(cup, handle)


def bowl() -> Mesh:
    outer = [(5 * np.sin(t), -5 * np.cos(t)) for t in np.linspace(0, np.pi / 2, 24)]
    inner = [(4 * np.sin(t), -4 * np.cos(t)) for t in np.linspace(np.pi / 2, 0, 24)]
    return revolved([*outer, *inner])


def bracket() -> Mesh:
    return joined(
        box((10, 6, 2), (0, 0, 0)), box((2, 6, 9), (-4, 0, 3.5)), box((7, 1.5, 2), (0, 0, 1.5))
    )


def letter() -> Mesh:
    return joined(box((9, 2, 2), (0, 0, 6)), box((2.5, 2, 12), (0, 0, 0)))


def ellipsoid() -> Mesh:
    mesh = trimesh.creation.icosphere(subdivisions=4)
    mesh.apply_scale([3.0, 2.0, 1.4])
    mesh.apply_transform(trimesh.transformations.rotation_matrix(0.5, [1, 2, 3]))
    return mesh


MESHES: dict[str, Callable[[], Mesh]] = {
    "blob": blob,
    "torus": lambda: trimesh.creation.torus(2.0, 0.8),
    "gear": gear,
    "pawn": pawn,
    "mug": mug,
    "star": star,
    "letter": letter,
    "bracket": bracket,
    "bowl": bowl,
    "ellipsoid": ellipsoid,
}


def meshes(reference_seconds: float) -> Section:
    """Voxelise twenty meshes to 1000 cells, by cells and by 2×2×2 blocks, and a large mesh."""
    from bench.held_out_meshes import HELD_OUT

    del reference_seconds
    section = Section(name="meshes")
    _voxelised(section, MESHES, "as tuned with")
    _voxelised(section, HELD_OUT, "held out")
    _large(section)
    return section


def _voxelised(section: Section, forms: dict[str, Callable[[], Mesh]], kind: str) -> None:
    """Measure the IoU of some meshes; the held-out ones were not used to tune parameters."""
    rows: list[dict[str, object]] = []
    ious: list[tuple[float, float]] = []
    is_within: list[bool] = []
    for name, make in forms.items():
        mesh = make()
        solid = Solid.from_triangles(mesh.vertices, mesh.faces, name=name)
        start_s = time.perf_counter()
        exact = voxelise(solid, cells=MESH_CELLS)
        seconds = time.perf_counter() - start_s
        blocks = voxelise(solid, cells=MESH_CELLS // 8)
        ious.append((exact.iou, blocks.iou))
        offered = [count for count in (blocks.below, blocks.above) if count is not None]
        is_within += [len(voxelise(solid, cells=count).shape) == count for count in offered]
        rows.append(
            {
                "mesh": name,
                "set": kind,
                "triangles": len(solid),
                "cells": len(exact.shape),
                "iou": exact.iou,
                "cells in blocks": 8 * len(blocks.shape),
                "iou of blocks": blocks.iou,
                "seconds": seconds,
                "notes": " ".join((*solid.notes, *exact.notes)),
            }
        )
    section.rows += rows
    mean, rough = (float(np.mean(values)) for values in zip(*ious, strict=True))
    section.add(
        f"IoU with the mesh, {MESH_CELLS} modules, mean of {len(rows)} {kind}",
        f"{mean:.3f}",
        f"≥ {MIN_MEAN_IOU}",
        mean >= MIN_MEAN_IOU,
    )
    section.add(f"the same {kind} made of blocks of 2×2×2", f"{rough:.3f}")
    section.add(
        f"counts offered for blocks, {kind}, that asking for them gives",
        f"{sum(is_within)} of {len(is_within)}",
        f"{len(is_within)}",
        all(is_within),
    )


def _large(section: Section) -> None:
    """Measure a mesh of 100 000 triangles, from a file to a path, in a separate process."""
    fine = trimesh.creation.torus(2.0, 0.8, major_sections=250, minor_sections=200)
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as directory:
        file, out = Path(directory) / "torus.stl", Path(directory) / "path.json"
        file.write_bytes(fine.export(file_type="stl"))
        command = [
            *(sys.executable, "-m", "foldback.server.cli.command_line", "shape", str(file)),
            *("--modules", str(MESH_CELLS), "--method", "blocks", "--out", str(out), "--json"),
        ]
        start_s = time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        with watched(process.pid) as memory_readings:
            _, status, usage = os.wait4(process.pid, 0)
            seconds = time.perf_counter() - start_s
        process.returncode = os.waitstatus_to_exitcode(status)
        cells = len(json.loads(out.read_bytes())["cells"]) if out.exists() else 0
    label = f"{len(fine.faces)} triangles → path of {cells} modules by blocks"
    section.add(
        f"{label}, process and imports included",
        f"{seconds:.2f} s",
        f"< {MAX_LARGE_MESH_S} s",
        process.returncode == 0 and seconds < MAX_LARGE_MESH_S,
    )
    memory = max(memory_readings) / 2**20
    section.add(f"{label}, processor", f"{usage.ru_utime + usage.ru_stime:.2f} s", "reported")
    section.add(
        f"{label}, memory",
        f"{memory:.0f} MB",
        f"< {MAX_LARGE_MESH_MIB:.0f} MB",
        memory < MAX_LARGE_MESH_MIB,
    )
