"""GLB and glTF: a scene of meshes in one file. Nothing outside the file is ever looked for.

A scene has y up and a solid has z up, so scenes are turned by a quarter about x.
"""

from __future__ import annotations

import base64
import binascii
from dataclasses import replace
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array
from foldback.planner.errors import InputError
from foldback.planner.readers.limits import Source, quote
from foldback.planner.readers.strict_json import parse
from foldback.planner.readers.trimesh_meshes import Triangles, incomplete, joined, placed
from foldback.planner.shapes.polygons import fans
from foldback.planner.shapes.solid import Solid, check_triangles

GLB_MAGIC: Final = b"glTF"
JSON_CHUNK: Final = 0x4E4F534A
"""Type code of the chunk of a GLB file that holds JSON, from section 4.4.3 of the glTF 2.0
specification."""
BINARY_CHUNK: Final = 0x004E4942
"""Type code of the chunk of a GLB file that holds binary data, from section 4.4.3 of the glTF 2.0
specification."""
MAX_NODES: Final = 100_000
"""Maximum number of nodes, and of placed meshes, of a glTF scene; a scene with more is refused."""
MAX_GLTF_VERTICES: Final = 20_000_000
"""Maximum number of vertices of all parts of a glTF scene, where vertices that several parts share
count for each; a scene with more is refused."""
COMPONENT_TYPES: Final = {
    5120: "<i1",
    5121: "<u1",
    5122: "<i2",
    5123: "<u2",
    5125: "<u4",
    5126: "<f4",
}
"""NumPy type for each ``componentType`` code of an accessor (a typed array) in a glTF file, from
the glTF 2.0 specification."""
WIDTHS: Final = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
PACKED: Final = {
    "KHR_draco_mesh_compression": "Draco",
    "EXT_meshopt_compression": "meshopt",
    "KHR_meshopt_compression": "meshopt",
}
"""glTF extensions that compress geometry, and the names of the methods."""
INSTANCING: Final = "EXT_mesh_gpu_instancing"
VISIBILITY: Final = "KHR_node_visibility"
READ_GLTF_EXTENSIONS: Final = (INSTANCING, VISIBILITY, "KHR_mesh_quantization")
"""glTF extensions that change the geometry and are supported by the reader; files that require
other ones are refused."""
IGNORED_EXTENSION_PREFIXES: Final = (
    *("KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_", "KHR_lights_"),
    *("EXT_lights_", "KHR_xmp", "KHR_animation_pointer", "KHR_audio", "EXT_structural_metadata"),
    *("EXT_mesh_features", "EXT_instance_features", "KHR_techniques_webgl"),
)
"""Beginnings of the names of glTF extensions that do not affect the geometry (materials, textures);
the reader ignores such extensions."""
Y_TO_Z: Final = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
TRIANGLES, STRIP, FAN = 4, 5, 6
TAIL_IGNORED: Final = "data after the end of the scene was ignored."

Document = dict[str, Any]


def is_glb(data: bytes) -> bool:
    """Return True if the bytes begin with the signature of GLB."""
    return data.startswith(GLB_MAGIC)


def is_gltf(document: Document) -> bool:
    """Return True if a JSON object is a glTF scene."""
    return isinstance(document.get("asset"), dict) and "format" not in document


def read_glb(data: bytes, source: Source) -> Solid:
    """Return the solid in a GLB file.

    Raises:
        InputError: The header is wrong, the scene refers to other files, or is no solid.
    """
    chunks = _chunks(data)
    if JSON_CHUNK not in chunks:
        raise _damaged("the file has no JSON chunk")
    try:
        text = chunks[JSON_CHUNK].decode("utf-8")
    except UnicodeDecodeError as error:
        raise _damaged("the JSON of the file is not text") from error
    value = parse(text)
    if not isinstance(value, dict):
        raise _damaged("the JSON text of the file is not a JSON object")
    solid = read_gltf(cast("Document", value), source, binary=chunks.get(BINARY_CHUNK))
    length = int.from_bytes(data[8:12], "little")
    return replace(solid, notes=(*solid.notes, TAIL_IGNORED)) if len(data) > length else solid


def read_gltf(document: Document, source: Source, binary: bytes | None = None) -> Solid:
    """Return the solid in the JSON of a glTF scene and its binary chunk.

    Raises:
        InputError: The scene is damaged, refers to other files, or is no solid.
    """
    try:
        scene = _Scene(document, binary, source)
        with np.errstate(all="ignore"):  # what is not finite is refused with the solid
            points, faces = scene.triangles()
            points = points @ Y_TO_Z.T
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise _damaged(f"the scene is broken ({_reason(error)})") from error
    return Solid.from_triangles(
        points,
        faces,
        name=source.name or "solid",
        notes=scene.notes,
        max_triangles=source.max_triangles,
    )


def _reason(error: Exception) -> str:
    """Return the reason for an error, in words for people."""
    match error:
        case KeyError():
            return f"{quote(str(error))} is missing"
        case _InvalidValueError():
            return str(error)
        case IndexError():
            return "an entry refers to a missing entry"
        case _:
            return "an entry has a value of the wrong kind"


class _InvalidValueError(ValueError):
    """An invalid value, with a message for people."""


def _damaged(problem: str) -> InputError:
    return InputError("damaged", f"{problem}; export the scene again as GLB.")


def _chunks(data: bytes) -> dict[int, bytes]:
    if len(data) < 12:
        raise InputError("truncated", "the file ends within its header; save or send it again.")
    version, length = (int.from_bytes(data[i : i + 4], "little") for i in (4, 8))
    if version != 2:
        raise InputError("wrong-version", f"got version {version} of GLB, expected version 2.")
    if length > len(data):
        raise InputError(
            "truncated",
            f"the header declares {length} bytes, but the file has {len(data)}; save or send it "
            "again.",
        )
    chunks: dict[int, bytes] = {}
    at = 12
    while at + 8 <= length:
        size = int.from_bytes(data[at : at + 4], "little")
        kind = int.from_bytes(data[at + 4 : at + 8], "little")
        if at + 8 + size > len(data):
            raise InputError(
                "truncated",
                f"a chunk of {size} bytes reaches beyond the end of the file; save or send the "
                "file again.",
            )
        chunks.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    return chunks


def _decoded(entry: Document, binary: bytes | None) -> bytes:
    """Return the bytes of a buffer."""
    uri = entry.get("uri")
    if uri is None:
        if binary is None:
            raise _damaged("a buffer has no data")
        return binary
    head, comma, body = str(uri).partition(",")
    if not comma or not head.endswith(";base64"):
        raise _damaged("a buffer is not base64 data")
    try:
        return base64.b64decode(body, validate=True)
    except (binascii.Error, ValueError) as error:
        raise _damaged("a buffer's base64 is broken") from error


class _Scene:
    """Triangles of a scene; every bound is checked before it is used.

    trimesh reads whatever it finds and takes missing data for zeros, so it does not read these.
    """

    def __init__(self, document: Document, binary: bytes | None, source: Source) -> None:
        self._document = document
        self._max_triangles = source.max_triangles
        self._notes: dict[str, None] = {}
        _check_version(document["asset"])
        _check_extensions(document, self._notes)
        if document.get("animations"):
            self._notes["animations were ignored; the parts are in their original positions."] = (
                None
            )
        self._binary = binary
        self._buffers: dict[int, bytes] = {}

    def _buffer(self, index: int) -> bytes:
        """Return the bytes of a buffer. Only those with geometry are looked at."""
        if index not in self._buffers:
            entry = self._document["buffers"][index]
            uri = entry.get("uri")
            if uri is not None and not str(uri).startswith("data:"):
                raise InputError(
                    "outside-reference",
                    f"the geometry is in another file, {quote(str(uri))!r}; export the scene as "
                    "GLB with all of its data inside.",
                    where=f"buffers[{index}]",
                )
            self._buffers[index] = _decoded(entry, None if index else self._binary)
        return self._buffers[index]

    def _is_placeholder(self, index: int) -> bool:
        """Return True if a buffer only states a length, for a reader that unpacks another one."""
        entry = self._document["buffers"][index]
        lacks = "uri" not in entry and (index > 0 or self._binary is None)
        return lacks or bool(_packed(entry))

    @property
    def notes(self) -> tuple[str, ...]:
        """Messages about omitted parts of the scene."""
        return tuple(self._notes)

    def triangles(self) -> Triangles:
        """Return the triangles of all parts, each where the scene puts it.

        The announced numbers are checked before any array is made.
        """
        nodes = self._nodes()
        used = [mesh for mesh, _ in nodes]
        primitives = {mesh: self._primitives(mesh) for mesh in used}
        counts = {m: sum(self._triangles(p) for p in every) for m, every in primitives.items()}
        check_triangles(sum(counts[mesh] for mesh in used), self._max_triangles)
        points = {m: sum(len(self._places(p)) for p in every) for m, every in primitives.items()}
        if (total := sum(points[mesh] for mesh in used)) > MAX_GLTF_VERTICES:
            raise InputError(
                "too-large",
                f"got {total} vertices in all parts together, expected at most "
                f"{MAX_GLTF_VERTICES}; simplify the meshes of the scene.",
            )
        parts = {mesh: [self._part(p) for p in every] for mesh, every in primitives.items()}
        # The last part comes first, as trimesh has it: how a solid is oriented depends on it.
        placed_parts = [
            placed(part, transform) for mesh, transform in nodes[::-1] for part in parts[mesh]
        ]
        if not placed_parts:
            raise incomplete("glb", "no triangles")
        return joined(placed_parts)

    def _nodes(self) -> list[tuple[int, Array]]:
        """Return the meshes that the scene reaches, each with its (4, 4) transform.

        A file without nodes has every mesh once, where it is.
        """
        nodes = self._document.get("nodes", [])
        if not nodes:
            return [(i, np.eye(4)) for i in range(len(self._document.get("meshes", [])))]
        if len(nodes) > MAX_NODES:
            raise InputError(
                "too-large",
                f"got {len(nodes)} nodes, expected at most {MAX_NODES}; simplify the scene.",
            )
        scenes = self._document.get("scenes", [])
        if len(scenes) > 1 and "scene" not in self._document:
            self._notes[f"the file has {len(scenes)} scenes; the first one was read."] = None
        if scenes:
            scene = self._document.get("scene", 0)
            if not 0 <= scene < len(scenes):
                raise _damaged(
                    f"the file refers to scene {scene}, but its last scene is {len(scenes) - 1}"
                )
            roots = scenes[scene].get("nodes", [])
        else:
            children = {c for node in nodes for c in node.get("children", [])}
            roots = [i for i in range(len(nodes)) if i not in children]
        meshes: list[tuple[int, Array]] = []
        reached: set[int] = set()
        waiting = [(int(root), np.eye(4), True) for root in roots]
        while waiting:
            index, above, visible = waiting.pop()
            if index in reached or index < 0:
                raise _damaged(f"node {index} is missing or is used twice")
            reached.add(index)
            node = nodes[index]
            with np.errstate(all="ignore"):
                transform = above @ _transform(node)
            if not np.isfinite(transform).all():
                raise _damaged(f"the transform of node {index} has infinite or undefined numbers")
            extensions = node.get("extensions", {})
            if not extensions.get(VISIBILITY, {}).get("visible", True):
                self._notes["hidden parts were ignored."] = None
                visible = False
            if "mesh" in node and visible:
                places = [transform]
                if INSTANCING in extensions:
                    places = self._instances(extensions[INSTANCING]["attributes"], transform)
                meshes += [(int(node["mesh"]), place) for place in places]
                self._note_deformation(node)
            if len(meshes) > MAX_NODES:
                raise InputError(
                    "too-large",
                    f"got {len(meshes)} parts, expected at most {MAX_NODES}; join parts.",
                )
            waiting += [(int(child), transform, visible) for child in node.get("children", [])]
        self._note_unreached(reached)
        return meshes

    def _note_unreached(self, reached: set[int]) -> None:
        """Note that the file has meshes outside of its scene.

        Args:
            reached: Nodes of the scene.
        """
        nodes = self._document["nodes"]
        meshes = {nodes[index].get("mesh") for index in reached} - {None}
        any_unreached = any("mesh" in node for i, node in enumerate(nodes) if i not in reached)
        if any_unreached or len(meshes) < len(self._document.get("meshes", [])):
            self._notes["meshes outside of the scene were ignored."] = None

    def _instances(self, attributes: Document, node: Array) -> list[Array]:
        """Return the places of a mesh that a node repeats, (4, 4) each."""
        shapes = {"TRANSLATION": "VEC3", "ROTATION": "VEC4", "SCALE": "VEC3"}
        columns = {
            name: self._values(attributes[name], kind).astype(np.float64)
            for name, kind in shapes.items()
            if name in attributes
        }
        counts = [len(values) for values in columns.values()]
        counts = counts or [_count(self._document["accessors"][k]) for k in attributes.values()]
        count = min(counts, default=1)
        if count > MAX_NODES:
            raise InputError(
                "too-large",
                f"got {count} copies (instances) of a mesh, expected at most {MAX_NODES}; use "
                "fewer copies.",
            )
        rows = [{n.lower(): v[k].tolist() for n, v in columns.items()} for k in range(count)]
        with np.errstate(all="ignore"):
            places = [node @ _transform(row) for row in rows]
        if not np.isfinite(places).all():
            raise _damaged("the transforms of instances have infinite or undefined numbers")
        return places

    def _note_deformation(self, node: Document) -> None:
        """Note that a deformed mesh is read in its undeformed form."""
        mesh = self._document["meshes"][int(node["mesh"])]
        if "skin" in node:
            self._notes["the skeleton was ignored; the mesh is in its original pose."] = None
        if any(node.get("weights", mesh.get("weights", []))):
            self._notes["morph targets were ignored; the mesh is in its original shape."] = None

    def _primitives(self, mesh: int) -> list[Document]:
        if mesh < 0:
            raise IndexError(f"mesh {mesh}")
        every = self._document["meshes"][mesh]["primitives"]
        supported = [p for p in every if p.get("mode", TRIANGLES) in (TRIANGLES, STRIP, FAN)]
        if len(supported) < len(every):
            self._notes["points and lines were ignored."] = None
        used = [p for p in supported if self._triangles(p) and self._points(p)]
        for primitive in used:
            # Counts that the file cannot hold are refused before they are added up.
            if (packed := _packed(primitive)) and self._lacks_data(primitive):
                raise _compressed(packed)
            self._values(primitive["attributes"]["POSITION"], "VEC3")
            if "indices" in primitive:
                self._values(primitive["indices"], "SCALAR")
        return used

    def _lacks_data(self, primitive: Document) -> bool:
        """Return True if a primitive has no data beside that of an extension."""
        accessor = self._document["accessors"][primitive["attributes"]["POSITION"]]
        return "bufferView" not in accessor

    def _points(self, primitive: Document) -> int:
        """Return the number of points that a primitive declares."""
        return _count(self._document["accessors"][primitive["attributes"]["POSITION"]])

    def _triangles(self, primitive: Document) -> int:
        """Return the number of triangles that a primitive declares."""
        place = primitive.get("indices", primitive["attributes"]["POSITION"])
        corners = _count(self._document["accessors"][place])
        mode = primitive.get("mode", TRIANGLES)
        return corners // 3 if mode == TRIANGLES else max(0, corners - 2)

    def _places(self, primitive: Document) -> NDArray[Any]:
        """Return the (P, 3) points of a primitive as the file has them."""
        return self._values(primitive["attributes"]["POSITION"], "VEC3")

    def _part(self, primitive: Document) -> Triangles:
        """Return the points and triangles of a primitive, in the frame of its mesh."""
        points = self._places(primitive).astype(np.float64)
        corners = np.arange(len(points), dtype=np.int64)
        if "indices" in primitive:
            numbers = self._values(primitive["indices"], "SCALAR")
            if numbers.dtype.kind == "f":
                raise _InvalidValueError("indices that are not whole numbers")
            corners = numbers.ravel().astype(np.int64)
        if corners.max() >= len(points):
            raise InputError(
                "bad-index",
                f"a triangle uses vertex {corners.max()}, but there are {len(points)} vertices, "
                "counted from 0; export the scene again.",
            )
        mode = primitive.get("mode", TRIANGLES)
        if mode == TRIANGLES:
            return points, corners[: len(corners) // 3 * 3].reshape(-1, 3)
        if mode == FAN:
            return points, fans(corners, np.array([len(corners)]))
        from trimesh.util import triangle_strips_to_faces

        return points, np.asarray(triangle_strips_to_faces([corners]), dtype=np.int64)

    def _values(self, index: int, expected: str) -> NDArray[Any]:
        """Return the (count, width) values of an accessor after a check of every bound."""
        accessor = self._document["accessors"][index]
        if "sparse" in accessor:
            raise InputError(
                "unsupported",
                "the mesh has sparse accessors, which are not supported; export it without them.",
            )
        if "bufferView" not in accessor:
            raise InputError(
                "unsupported",
                "the mesh has no uncompressed data; export it without compression.",
                where=f"accessors[{index}]",
            )
        if accessor["type"] != expected:
            raise _InvalidValueError(
                f"an accessor has the type {quote(accessor['type'])} instead of {expected}"
            )
        kind = np.dtype(COMPONENT_TYPES[accessor["componentType"]])
        view = self._document["bufferViews"][accessor["bufferView"]]
        if (packed := _packed(view)) and self._is_placeholder(view["buffer"]):
            raise _compressed(packed)
        buffer = self._buffer(view["buffer"])
        width = WIDTHS[expected]
        size = kind.itemsize * width
        stride = int(view.get("byteStride", size))
        count = _count(accessor)
        inner = int(accessor.get("byteOffset", 0))
        start = int(view.get("byteOffset", 0)) + inner
        end = start + stride * (count - 1) + size
        if min(inner, start) < 0 or stride < size or stride > 4096:
            raise _InvalidValueError("an accessor has an impossible offset or stride")
        if end > len(buffer) or end > start - inner + int(view["byteLength"]):
            raise InputError(
                "truncated",
                f"an accessor declares {count} values, but its buffer has fewer; export the "
                "scene again.",
                where=f"accessors[{index}]",
            )
        values: NDArray[Any] = np.ndarray(
            (count, width), kind, buffer, start, (stride, kind.itemsize)
        )
        if accessor.get("normalized") and kind.kind in "iu":  # which trimesh takes for lengths
            return np.maximum(values / float(np.iinfo(kind).max), -1.0).astype("<f4")
        return values


def _check_version(asset: Document) -> None:
    """Refuse scenes that a reader of glTF 2.0 must not read.

    Raises:
        InputError: ``wrong-version``.
    """
    version = str(asset.get("minVersion", asset.get("version", "2.0")))
    if version != "2.0" and ("minVersion" in asset or not version.startswith("2.")):
        raise InputError(
            "wrong-version", f"got version {quote(version)} of glTF, expected version 2.0."
        )


def _check_extensions(document: Document, notes: dict[str, None]) -> None:
    """Refuse required geometry extensions that are not read; note optional ones."""
    required = document.get("extensionsRequired", [])
    for name in dict.fromkeys([*required, *document.get("extensionsUsed", [])]):
        if name in READ_GLTF_EXTENSIONS or str(name).startswith(IGNORED_EXTENSION_PREFIXES):
            continue
        if name in PACKED and name in required:
            raise _compressed(name)
        if name in required:
            raise InputError(
                "unsupported",
                f"the scene requires the extension {quote(str(name))!r}, which is not supported; "
                "export it without this extension.",
            )
        notes[f"the extension {quote(str(name))!r} was ignored."] = None


def _packed(entry: Document) -> str:
    """Return the extension that compresses a primitive or a view of a buffer; empty if none."""
    return next((name for name in PACKED if name in entry.get("extensions", {})), "")


def _compressed(name: str) -> InputError:
    return InputError(
        "unsupported",
        f"the mesh is compressed with {PACKED[name]} ({name}); export it without compression.",
    )


def _count(accessor: Document) -> int:
    count = int(accessor["count"])
    if count < 0:
        raise _InvalidValueError(f"an accessor declares {count} values")
    return count


def _transform(node: Document) -> Array:
    if "matrix" in node:
        matrix = np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
        if matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
            raise _InvalidValueError("a matrix whose last row is not 0, 0, 0, 1")
        return matrix
    from trimesh import transformations

    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    a, b, c = node.get("scale", (1.0, 1.0, 1.0))
    moved = transformations.translation_matrix(node.get("translation", (0.0, 0.0, 0.0)))
    return moved @ transformations.quaternion_matrix((w, x, y, z)) @ np.diag((a, b, c, 1.0))
