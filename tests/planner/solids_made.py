"""Meshes and voxel files for tests, made and written by third-party code."""

import io
import json
import struct
import zipfile
from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from foldback.planner.shapes.solid import Solid

Mesh = trimesh.Trimesh


def torus() -> Mesh:
    return trimesh.creation.torus(2.0, 0.7, major_sections=24, minor_sections=12)


def box(*sides: float) -> Mesh:
    return trimesh.creation.box(sides)


def solid_of(mesh: Mesh) -> Solid:
    return Solid.from_triangles(mesh.vertices, mesh.faces, name="solid")


def exported(kind: str, mesh: Mesh) -> bytes:
    """Return a mesh in a file format, as trimesh writes it."""
    if kind == "3mf":
        data = trimesh.Scene(mesh).export(file_type="3mf")
    elif kind == "gltf":
        files = trimesh.Scene(mesh).export(file_type="gltf", embed_buffers=True)
        data = files["model.gltf"]
    elif kind == "ply_ascii":
        data = mesh.export(file_type="ply", encoding="ascii")
    else:
        data = mesh.export(file_type=kind)
    return data.encode() if isinstance(data, str) else data


def scene(edit: Callable[[dict[str, Any]], object], mesh: Mesh | None = None) -> bytes:
    """Return a glTF scene after an edit, by default of a box of volume 24."""
    document = json.loads(exported("gltf", box(2, 3, 4) if mesh is None else mesh))
    edit(document)
    return json.dumps(document).encode()


def show(document: dict[str, Any], *nodes: dict[str, Any], **extra: Any) -> None:
    """Set the nodes of a glTF scene, each with the first mesh."""
    document.update(nodes=[{"mesh": 0, **node} for node in nodes], scene=0, **extra)
    document["scenes"] = [{"nodes": list(range(len(nodes)))}]


MESH_KINDS = ("stl", "stl_ascii", "obj", "ply", "ply_ascii", "off", "glb", "gltf", "3mf")


def chunk(kind: bytes, body: bytes) -> bytes:
    return kind + struct.pack("<II", len(body), 0) + body


def words(**pairs: str) -> bytes:
    body = struct.pack("<I", len(pairs))
    for key, value in pairs.items():
        for word in (key.encode(), value.encode()):
            body += struct.pack("<I", len(word)) + word
    return body


def vox_model(cells: NDArray[np.int64]) -> bytes:
    size = cells.max(axis=0) + 1
    rows = b"".join(bytes([*cell, 1]) for cell in cells.tolist())
    return chunk(b"SIZE", struct.pack("<3I", *size.tolist())) + chunk(
        b"XYZI", struct.pack("<I", len(cells)) + rows
    )


def vox_transform(node: int, child: int, **place: str) -> bytes:
    """Return a scene node that transforms another one."""
    ends = struct.pack("<4i", child, -1, 0, 1)
    return chunk(b"nTRN", struct.pack("<I", node) + words() + ends + words(**place))


def vox_shape(node: int, model: int) -> bytes:
    """Return a scene node that shows a model."""
    header = struct.pack("<2I", 1, model)
    return chunk(b"nSHP", struct.pack("<I", node) + words() + header + words())


def vox_file(*chunks: bytes) -> bytes:
    body = b"".join(chunks)
    return b"VOX " + struct.pack("<I", 150) + b"MAIN" + struct.pack("<II", 0, len(body)) + body


def as_vox(cells: NDArray[np.int64]) -> bytes:
    return vox_file(vox_model(cells), chunk(b"RGBA", bytes(1024)))


def as_binvox(cells: NDArray[np.int64]) -> bytes:
    x, y, z = (cells.max(axis=0) + 1).tolist()
    grid = np.zeros((x, z, y), dtype=np.uint8)
    grid[cells[:, 0], cells[:, 2], cells[:, 1]] = 1
    data = b"#binvox 1\ndim %d %d %d\ntranslate 0 0 0\nscale 1\ndata\n" % (x, z, y)
    flat = grid.ravel()
    starts = np.flatnonzero(np.concatenate([[True], flat[1:] != flat[:-1]]))
    for start, end in zip(starts, [*starts[1:], len(flat)], strict=True):
        byte_count = int(end - start)
        while byte_count:
            data += bytes([flat[start], min(byte_count, 255)])
            byte_count -= min(byte_count, 255)
    return data


def npy(values: object) -> bytes:
    """Return an array as numpy.save writes it."""
    stream = io.BytesIO()
    np.save(stream, np.asanyarray(values))
    return stream.getvalue()


def as_grid(cells: NDArray[np.int64]) -> bytes:
    grid = np.zeros(tuple(cells.max(axis=0) + 1), dtype=bool)
    grid[tuple(cells.T)] = True
    return npy(grid)


VOXEL_WRITERS: tuple[Callable[[NDArray[np.int64]], bytes], ...] = (as_vox, as_binvox, as_grid)


def zipped(**files: bytes) -> bytes:
    """Return a zip archive; in names double underscores become slashes, ``_model`` .model.

    Its files have no times: archives are in the names of tests, which must not change.
    """
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, data in files.items():
            file = zipfile.ZipInfo(name.replace("__", "/").replace("_model", ".model"))
            archive.writestr(file, data, zipfile.ZIP_DEFLATED)
    return stream.getvalue()
