"""GLB and glTF: a scene of meshes in one file. Nothing outside the file is ever looked for."""

from __future__ import annotations

import base64
import binascii
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.readers.json_text import parse
from planner.readers.limits import Source, quote
from planner.shapes.solid import Solid, check_triangles

MAGIC: Final = b"glTF"
JSON_CHUNK: Final = 0x4E4F534A
BINARY_CHUNK: Final = 0x004E4942
MOST_NODES: Final = 100_000
KINDS: Final = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS: Final = {"SCALAR": 1, "VEC3": 3}
PACKED: Final = ("KHR_draco_mesh_compression", "EXT_meshopt_compression")
TRIANGLES, STRIP, FAN = 4, 5, 6

Floats = NDArray[np.float64]
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
    """The triangles of a scene, collected with its nodes' transforms."""

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
        self._meshes: dict[int, tuple[Floats, Ints]] = {}

    def solid(self) -> Solid:
        """All triangles of the scene as one solid."""
        instances = self._instances()
        total = sum(self._triangles(mesh) for mesh, _ in instances)
        check_triangles(total, self._source.most_triangles)
        points: list[Floats] = []
        faces: list[Ints] = []
        rows = 0
        for mesh, transform in instances:
            own, corners = self._mesh(mesh)
            with np.errstate(all="ignore"):
                points.append(own @ transform[:3, :3].T + transform[:3, 3])
                mirrored = np.linalg.det(transform[:3, :3]) < 0
            faces.append((corners[:, ::-1] if mirrored else corners) + rows)
            rows += len(own)
        return Solid.from_triangles(
            np.concatenate(points),
            np.concatenate(faces),
            name=self._source.name or "solid",
            notes=sorted(self._notes),
            most_triangles=self._source.most_triangles,
        )

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

    def _instances(self) -> list[tuple[int, Floats]]:
        """Meshes of the scene and their transforms; without nodes, every mesh as it is."""
        nodes = self._document.get("nodes", [])
        if not nodes:
            return [(i, np.eye(4)) for i in range(len(self._document.get("meshes", [])))]
        if len(nodes) > MOST_NODES:
            raise InputError("too-large", f"got {len(nodes)} nodes, expected {MOST_NODES} at most.")
        scenes = self._document.get("scenes", [])
        if scenes:
            roots = scenes[self._document.get("scene", 0)].get("nodes", [])
        else:
            children = {c for node in nodes for c in node.get("children", [])}
            roots = [i for i in range(len(nodes)) if i not in children]
        found: list[tuple[int, Floats]] = []
        seen: set[int] = set()
        waiting = [(int(root), np.eye(4)) for root in roots]
        while waiting:
            index, above = waiting.pop()
            if index in seen or index < 0:
                raise _damaged(f"node {index} is reached twice or is none")
            seen.add(index)
            node = nodes[index]
            with np.errstate(all="ignore"):
                transform = above @ _transform(node)
            if not np.isfinite(transform).all():
                raise _damaged(f"node {index} is moved by numbers that are not finite")
            if "mesh" in node:
                found.append((int(node["mesh"]), transform))
            waiting += [(int(child), transform) for child in node.get("children", [])]
        return found

    def _primitives(self, mesh: int) -> list[Document]:
        if mesh < 0:
            raise IndexError(f"mesh {mesh}")
        kept: list[Document] = []
        for primitive in self._document["meshes"][mesh]["primitives"]:
            if primitive.get("mode", TRIANGLES) in (TRIANGLES, STRIP, FAN):
                kept.append(primitive)
            else:
                self._notes.add("points and lines were left out.")
        return kept

    def _triangles(self, mesh: int) -> int:
        """How many triangles a mesh announces, before anything is made of them."""
        total = 0
        for primitive in self._primitives(mesh):
            place = primitive.get("indices", primitive["attributes"]["POSITION"])
            count = int(self._document["accessors"][place]["count"])
            if count < 0:
                raise ValueError(f"a count of {count}")
            total += count // 3 if primitive.get("mode", TRIANGLES) == TRIANGLES else count
        return total

    def _mesh(self, mesh: int) -> tuple[Floats, Ints]:
        if mesh in self._meshes:
            return self._meshes[mesh]
        points: list[Floats] = [np.zeros((0, 3))]
        faces: list[Ints] = [np.zeros((0, 3), dtype=np.int64)]
        rows = 0
        for primitive in self._primitives(mesh):
            with np.errstate(invalid="ignore"):  # what is no number is refused with its place
                own = self._accessor(primitive["attributes"]["POSITION"], "VEC3").astype(float)
                corners = np.arange(len(own))
                if "indices" in primitive:
                    corners = self._accessor(primitive["indices"], "SCALAR").astype(np.int64)
            corners = corners.ravel()
            if len(corners) and corners.max() >= len(own):
                raise InputError("bad-index", f"got vertex {corners.max()} of {len(own)}.")
            faces.append(_cut(corners, primitive.get("mode", TRIANGLES)) + rows)
            points.append(own)
            rows += len(own)
        self._meshes[mesh] = np.concatenate(points), np.concatenate(faces)
        return self._meshes[mesh]

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


def _transform(node: Document) -> Floats:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    transform = np.eye(4)
    x, y, z, w = (float(v) for v in node.get("rotation", (0.0, 0.0, 0.0, 1.0)))
    transform[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    scale = np.array(node.get("scale", (1.0, 1.0, 1.0)), dtype=np.float64)
    transform[:3, :3] *= scale.reshape(1, 3)
    transform[:3, 3] = np.array(node.get("translation", (0.0, 0.0, 0.0)), dtype=np.float64)
    return transform
