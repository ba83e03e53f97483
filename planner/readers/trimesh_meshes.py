"""Meshes read by trimesh after a format's own check of the declared counts.

trimesh gets bytes and no resolver: it can neither find nor fetch another file. It is loaded with
the first mesh, since most inputs are paths.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.errors import InputError
from foldback.planner.readers.limits import quote

if TYPE_CHECKING:
    from trimesh import Scene

Format: TypeAlias = Literal["stl", "obj", "glb"]
Triangles: TypeAlias = "tuple[Array, Ints]"
"""Points (V, 3) and triangles (F, 3) as rows of them."""


def triangles_in(data: bytes, kind: Format) -> Triangles:
    """Return the triangles of all parts of a mesh or a scene, in the scene's frame.

    Args:
        data: A whole file whose announced counts are checked.
        kind: Its format.

    Raises:
        InputError: ``damaged``, when trimesh can't read it or finds no triangles in it.
    """
    import trimesh

    # Text that is no number ends the reading of numbers with a warning, and the rest would be lost.
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.filterwarnings("error", "string or file could not be read", DeprecationWarning)
        try:
            scene = trimesh.load_scene(
                io.BytesIO(data),
                file_type=kind,
                resolver=None,
                allow_remote=False,
                process=False,
                skip_materials=True,
            )
            parts = _parts(scene)
            del scene
        except MemoryError:
            raise
        except Exception as error:
            # Its readers raise of many kinds, from KeyError to those of other libraries.
            raise incomplete(kind, f"{type(error).__name__}: {quote(str(error))}") from error
    if not parts:
        raise incomplete(kind, "no triangles")
    return joined(parts)


def joined(parts: Sequence[Triangles]) -> Triangles:
    """Return the triangles of several parts as those of one; there must be at least one part."""
    if len(parts) == 1:
        return parts[0]
    before = np.cumsum([0, *(len(points) for points, _ in parts)])
    return (
        np.concatenate([points for points, _ in parts]),
        np.concatenate([faces + n for (_, faces), n in zip(parts, before[:-1], strict=True)]),
    )


def placed(part: Triangles, transform: Array) -> Triangles:
    """Return the triangles of a part in the scene's frame, still oriented outwards.

    Args:
        part: Points and triangles in the part's own frame.
        transform: (4, 4) homogeneous transform into the scene's frame.
    """
    points, faces = part
    if np.array_equal(transform, np.eye(4)):
        return part
    points = points @ transform[:3, :3].T + transform[:3, 3]
    mirrored = np.linalg.det(transform[:3, :3]) < 0
    return points, faces[:, ::-1] if mirrored else faces


def incomplete(kind: Format, problem: str) -> InputError:
    """Return the error for a mesh that cannot be read to its end."""
    return InputError(
        "damaged",
        f"got an incomplete {kind.upper()} mesh ({problem}), expected a complete one; save it "
        "again.",
    )


def _parts(scene: Scene) -> list[Triangles]:
    """Return points and triangles of each instance of a mesh, in the scene's frame."""
    import trimesh

    parts: list[Triangles] = []
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        mesh = scene.geometry[name]
        if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
            continue
        points = np.asarray(mesh.vertices, dtype=np.float64)
        faces = np.asarray(mesh.faces, dtype=np.int64)
        parts.append(placed((points, faces), transform))
    return parts
