"""Meshes as trimesh reads them, behind checks of what each kind of file announces.

The checks come first, because trimesh takes what it finds: a file that announces more than it holds
may be an empty mesh to it, or take all memory. Nothing outside of the bytes is ever looked for.
"""

from __future__ import annotations

import logging
import re
from io import BytesIO
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.readers.limits import Source, quote
from planner.shapes.solid import Solid, check_triangles

if TYPE_CHECKING:
    from trimesh import Scene, Trimesh

Kind = Literal["stl", "stl_ascii", "obj", "off", "glb", "gltf"]
NAMES: Final[dict[Kind, str]] = {"stl_ascii": "STL", "glb": "GLB", "gltf": "glTF"}

ODD: Final = re.compile(rb"[^\t-\r -~]")
NEWLINE: Final = b"\n"

logging.getLogger("trimesh").addHandler(logging.NullHandler())


def load(
    data: bytes,
    kind: Kind,
    source: Source,
    *,
    triangles: int | None = None,
    notes: tuple[str, ...] = (),
) -> Solid:
    """A solid of everything that a mesh file draws, its parts where the scene puts them.

    Args:
        data: The whole file; what it announces has been checked.
        kind: How trimesh calls its format.
        source: What else is known of it.
        triangles: How many the file announces, where it does.
        notes: What its reader has to say of it.

    Raises:
        InputError: ``damaged`` or ``bad-index`` when trimesh cannot read it, or reads less than is
            announced, ``no-triangles`` when there are none, and for meshes that are no solid.
    """
    import trimesh  # it takes a while, and only who reads meshes needs it

    try:
        with np.errstate(all="ignore"):  # what is no number is refused with its place
            scene = trimesh.load_scene(
                BytesIO(data), file_type=kind, process=False, skip_materials=True
            )
            points, faces = _drawn(scene)
    except IndexError as error:
        raise InputError(
            "bad-index",
            f"a triangle names a vertex that the file does not hold ({quote(str(error))}); "
            "export the mesh again.",
        ) from error
    except Exception as error:  # of seven kinds, whatever it stumbled over
        found = f"{type(error).__name__}: {quote(str(error))}"
        raise _damaged(kind, f"it cannot be read ({found})") from error
    check_triangles(len(faces), source.most_triangles)
    if triangles is not None and len(faces) != triangles:
        raise _damaged(kind, f"got {len(faces)} triangles of the {triangles} that it announces")
    return Solid.from_triangles(
        points,
        faces,
        name=source.name or "solid",
        notes=notes,
        most_triangles=source.most_triangles,
    )


def _drawn(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """(V, 3) vertices and (F, 3) triangles of all nodes of a scene; points and lines are not."""
    from trimesh import Trimesh

    points: list[NDArray[np.float64]] = [np.zeros((0, 3))]
    faces: list[NDArray[np.int64]] = [np.zeros((0, 3), dtype=np.int64)]
    rows = 0
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        mesh: Trimesh | object = scene.geometry[name]
        if not isinstance(mesh, Trimesh) or not len(mesh.faces):
            continue
        if mesh.faces.max() >= len(mesh.vertices):
            raise IndexError(f"vertex {mesh.faces.max()} of {len(mesh.vertices)}")
        points.append(mesh.vertices @ transform[:3, :3].T + transform[:3, 3])
        mirrored = np.linalg.det(transform[:3, :3]) < 0
        faces.append((mesh.faces[:, ::-1] if mirrored else mesh.faces) + rows)
        rows += len(mesh.vertices)
    return np.concatenate(points), np.concatenate(faces)


def check_plain(text: bytes, odd: re.Pattern[bytes] = ODD) -> None:
    """Refuses bytes that no number is written with, which trimesh would pass over.

    Args:
        text: Words and numbers.
        odd: What ends with such a byte.

    Raises:
        InputError: ``damaged``, naming the line.
    """
    if (found := odd.search(text)) is not None:
        raise InputError(
            "damaged",
            f"got the byte {found[0][-1]}, expected words and numbers; save the mesh again.",
            where=f"line {text.count(NEWLINE, 0, found.end() - 1) + 1}",
        )


def _damaged(kind: Kind, found: str) -> InputError:
    return InputError("damaged", f"{found}; save it again as {NAMES.get(kind, kind.upper())}.")
