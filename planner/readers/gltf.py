"""GLB and glTF: a scene of meshes in one file. Nothing outside the file is ever looked for."""

from __future__ import annotations

import base64
import binascii
import json
import struct
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.readers.json_text import parse
from planner.readers.limits import Source, quote
from planner.readers.meshes import load
from planner.shapes.solid import Solid, check_triangles

MAGIC: Final = b"glTF"
JSON_CHUNK: Final = 0x4E4F534A
BINARY_CHUNK: Final = 0x004E4942
MOST_NODES: Final = 100_000
KINDS: Final = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS: Final = {"SCALAR": 1, "VEC3": 3}
PACKED: Final = ("KHR_draco_mesh_compression", "EXT_meshopt_compression")
TRIANGLES, STRIP, FAN = 4, 5, 6
OF_NODES: Final = ("mesh", "matrix", "translation", "rotation", "scale")
"""What a node says of what it draws, and where."""

Ints = NDArray[np.int64]
Document = dict[str, Any]


def is_glb(data: bytes) -> bool:
    """Whether the bytes begin as GLB files do."""
    return data.startswith(MAGIC)


def is_gltf(document: Document) -> bool:
    """Whether a JSON object is a glTF scene."""
    return isinstance(document.get("asset"), dict) and "format" not in document


def read_glb(data: bytes, source: Source) -> Solid:
    """A solid from a GLB file.

    Raises:
        InputError: For lying headers, references to other files, and meshes that are no solid.
    """
    chunks = _chunks(data)
    if JSON_CHUNK not in chunks:
        raise _damaged("the file has no JSON chunk")
    try:
        text = chunks[JSON_CHUNK].decode("utf-8")
    except UnicodeDecodeError as error:
        raise _damaged("its JSON is not text") from error
    value = parse(text)
    if not isinstance(value, dict):
        raise _damaged("its JSON is no object")
    return read_gltf(cast("Document", value), source, binary=chunks.get(BINARY_CHUNK))


def read_gltf(document: Document, source: Source, binary: bytes | None = None) -> Solid:
    """A solid from the JSON of a glTF scene and the binary chunk that came with it.

    Raises:
        InputError: For damaged scenes, references to other files, and meshes that are no solid.
    """
    try:
        return _Scene(document, binary, source).solid()
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise _damaged(f"its scene is broken ({type(error).__name__}: {quote(str(error))})") from (
            error
        )


def _damaged(found: str) -> InputError:
    return InputError("damaged", f"{found}; export the scene again as GLB.")


def _chunks(data: bytes) -> dict[int, bytes]:
    if len(data) < 12:
        raise InputError("truncated", "the file ends within its header; save or send it again.")
    version, length = (int.from_bytes(data[i : i + 4], "little") for i in (4, 8))
    if version != 2:
        raise InputError("wrong-version", f"got version {version} of GLB, expected version 2.")
    if length > len(data):
        raise InputError(
            "truncated",
            f"the header announces {length} bytes and the file has {len(data)}; save or send it "
            "again.",
        )
    found: dict[int, bytes] = {}
    at = 12
    while at + 8 <= length:
        size = int.from_bytes(data[at : at + 4], "little")
        kind = int.from_bytes(data[at + 4 : at + 8], "little")
        if at + 8 + size > len(data):
            raise InputError("truncated", f"a chunk of {size} bytes reaches behind the file's end.")
        found.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    return found


class _Scene:
    """What a scene draws, checked and without all else: a GLB that trimesh reads as it is meant."""

    def __init__(self, document: Document, binary: bytes | None, source: Source) -> None:
        self._document = document
        self._source = source
        self._binary = binary
        self._notes: set[str] = set()
        for name in document.get("extensionsRequired", []):
            if name in PACKED:
                raise InputError(
                    "unsupported",
                    f"the mesh is compressed with {name}; export it without compression.",
                )
        for key in ("buffers", "images"):
            for index, entry in enumerate(document.get(key, [])):
                uri = entry.get("uri")
                if uri is not None and not str(uri).startswith("data:"):
                    raise InputError(
                        "outside-reference",
                        f"it refers to {quote(str(uri))!r} outside of the file, which is not "
                        "fetched; export the scene as one file (GLB).",
                        where=f"{key}[{index}]",
                    )
        self._buffers = [self._buffer(b) for b in document.get("buffers", [])]
        self._packed: list[bytes] = []
        self._views: list[Document] = []
        self._accessors: list[Document] = []

    def solid(self) -> Solid:
        """All triangles of the scene as one solid."""
        roots, nodes = self._nodes()
        meshes = self._document.get("meshes", [])
        drawn = [int(node["mesh"]) for node in nodes if "mesh" in node]
        if drawn and not 0 <= min(drawn) <= max(drawn) < len(meshes):
            raise IndexError(f"a mesh of {len(meshes)}")
        primitives = {mesh: self._primitives(meshes[mesh]) for mesh in sorted(set(drawn))}
        counts = {mesh: sum(map(self._triangles, found)) for mesh, found in primitives.items()}
        total = sum(counts[mesh] for mesh in drawn)
        check_triangles(total, self._source.most_triangles)
        place = {mesh: i for i, mesh in enumerate(primitives)}
        for node in nodes:
            if "mesh" in node:
                node["mesh"] = place[node["mesh"]]
        document = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": roots}],
            "nodes": nodes,
            "meshes": [
                {"primitives": [self._plain(each) for each in found]}
                for found in primitives.values()
            ],
            "accessors": self._accessors,
            "bufferViews": self._views,
        }
        notes = tuple(sorted(self._notes))
        return load(_packed(document, self._packed), "glb", self._source, notes=notes)

    def _buffer(self, entry: Document) -> bytes:
        uri = entry.get("uri")
        if uri is None:
            return self._binary or b""
        head, comma, body = str(uri).partition(",")
        if not comma or not head.endswith(";base64"):
            raise _damaged("a buffer is no base64 data")
        try:
            return base64.b64decode(body, validate=True)
        except (binascii.Error, ValueError) as error:
            raise _damaged("a buffer's base64 is broken") from error

    def _nodes(self) -> tuple[list[int], list[Document]]:
        """The roots and all nodes of the scene, with what moves them; a node for each mesh if none.

        No node is reached twice.
        """
        given = self._document.get("nodes", [])
        if not given:
            count = len(self._document.get("meshes", []))
            return list(range(count)), [{"mesh": mesh} for mesh in range(count)]
        if len(given) > MOST_NODES:
            raise InputError("too-large", f"got {len(given)} nodes, expected {MOST_NODES} at most.")
        scenes = self._document.get("scenes", [])
        if scenes:
            roots = scenes[self._document.get("scene", 0)].get("nodes", [])
        else:
            children = {c for node in given for c in node.get("children", [])}
            roots = [i for i in range(len(given)) if i not in children]
        seen: dict[int, int] = {}
        waiting = [int(root) for root in roots]
        while waiting:
            index = waiting.pop()
            if index in seen or index < 0:
                raise _damaged(f"node {index} is reached twice or is none")
            seen[index] = len(seen)
            waiting += [int(child) for child in given[index].get("children", [])]
        nodes: list[Document] = []
        for index in seen:
            node = {name: given[index][name] for name in OF_NODES if name in given[index]}
            if children := [seen[int(child)] for child in given[index].get("children", [])]:
                node["children"] = children
            nodes.append(node)
        return [seen[int(root)] for root in roots], nodes

    def _primitives(self, mesh: Document) -> list[Document]:
        """Those of a mesh that are triangles; points and lines are noted."""
        kept: list[Document] = []
        for primitive in mesh["primitives"]:
            if primitive.get("mode", TRIANGLES) in (TRIANGLES, STRIP, FAN):
                kept.append(primitive)
            else:
                self._notes.add("points and lines were left out.")
        return kept

    def _triangles(self, primitive: Document) -> int:
        """How many triangles a primitive announces, before anything is made of them."""
        place = primitive.get("indices", primitive["attributes"]["POSITION"])
        count = int(self._document["accessors"][place]["count"])
        if count < 0:
            raise ValueError(f"a count of {count}")
        return count // 3 if primitive.get("mode", TRIANGLES) == TRIANGLES else count

    def _plain(self, primitive: Document) -> Document:
        """A primitive of plain triangles: its corners are 32-bit, its points are, too."""
        points = self._accessor(primitive["attributes"]["POSITION"], "VEC3")
        corners = np.arange(len(points))
        if "indices" in primitive:
            corners = self._accessor(primitive["indices"], "SCALAR").ravel()
        if len(corners) and corners.max() >= len(points):
            raise InputError("bad-index", f"got vertex {corners.max()} of {len(points)}.")
        triangles = _cut(corners, primitive.get("mode", TRIANGLES))
        with np.errstate(invalid="ignore"):  # what is no number is refused with its place
            position = self._added(points.astype("<f4"), 5126, "VEC3", len(points))
        indices = self._added(triangles.astype("<u4"), 5125, "SCALAR", triangles.size)
        return {"attributes": {"POSITION": position}, "indices": indices, "mode": TRIANGLES}

    def _added(self, values: NDArray[Any], kind: int, shape: str, count: int) -> int:
        """The number of a new accessor of these values."""
        start = sum(map(len, self._packed))
        self._packed.append(values.tobytes())
        self._views.append({"buffer": 0, "byteOffset": start, "byteLength": values.nbytes})
        view = len(self._views) - 1
        self._accessors.append(
            {"bufferView": view, "componentType": kind, "type": shape, "count": count}
        )
        return view

    def _accessor(self, index: int, expected: str) -> NDArray[Any]:
        """(count, width) values of an accessor, every bound checked before they are touched."""
        accessor = self._document["accessors"][index]
        if "sparse" in accessor or "bufferView" not in accessor:
            raise InputError("unsupported", "the mesh has sparse data; export it without.")
        if accessor["type"] != expected:
            raise ValueError(f"an accessor of type {accessor['type']}")
        kind = np.dtype(KINDS[accessor["componentType"]])
        view = self._document["bufferViews"][accessor["bufferView"]]
        buffer = self._buffers[view["buffer"]]
        width = WIDTHS[expected]
        size = kind.itemsize * width
        stride = int(view.get("byteStride", size))
        count = int(accessor["count"])
        inner = int(accessor.get("byteOffset", 0))
        start = int(view.get("byteOffset", 0)) + inner
        end = start + stride * (count - 1) + size
        if min(count, inner, start) < 0 or stride < size or stride > 4096:
            raise ValueError("an accessor with impossible numbers")
        if count and (end > len(buffer) or end > start - inner + int(view["byteLength"])):
            raise InputError(
                "truncated",
                f"an accessor announces {count} values and its buffer holds fewer; export the "
                "scene again.",
                where=f"accessors[{index}]",
            )
        if count == 0:
            return np.zeros((0, width), dtype=kind)
        values: NDArray[Any] = np.ndarray(
            (count, width), kind, buffer, start, (stride, kind.itemsize)
        )
        if accessor.get("normalized") and kind.kind in "iu":
            return np.maximum(values / float(np.iinfo(kind).max), -1.0)
        return values


def _cut(corners: Ints, mode: int) -> Ints:
    if mode == TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    if len(corners) < 3:
        return np.zeros((0, 3), dtype=np.int64)
    if mode == FAN:
        first = np.full(len(corners) - 2, corners[0])
        return np.column_stack([first, corners[1:-1], corners[2:]])
    strip = np.column_stack([corners[:-2], corners[1:-1], corners[2:]])
    strip[1::2] = strip[1::2, ::-1]
    return strip


def _packed(document: Document, binary: list[bytes]) -> bytes:
    """A GLB of a document and its buffer."""
    length = sum(map(len, binary))
    document["buffers"] = [{"byteLength": length}]
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    padding = bytes(-length % 4)
    whole = 28 + len(text) + length + len(padding)
    head = struct.pack("<4sIIII", MAGIC, 2, whole, len(text), JSON_CHUNK)
    chunk = struct.pack("<II", length + len(padding), BINARY_CHUNK)
    return b"".join([head, text, chunk, *binary, padding])
