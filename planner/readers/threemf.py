"""3MF: a zip archive with meshes in XML. What it unpacks to is bounded before it is unpacked."""

from __future__ import annotations

import io
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final
from xml.parsers import expat

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.errors import InputError
from foldback.planner.readers.limits import Source, parse_float, parse_int, quote
from foldback.planner.shapes.solid import Solid, check_triangles

ZIP_MAGIC: Final = b"PK\x03\x04"
ZIP_ENTRY: Final = b"PK\x01\x02"
"""Signature of an entry in the list of an archive's files."""
MAX_ENTRIES: Final = 4_000
"""Maximum number of files in a 3MF archive; an archive with more is refused."""
MAX_UNPACKED_BYTES: Final = 400 << 20
"""Maximum size of all models of a 3MF archive after unpacking, in bytes; an archive with more is
refused."""
FREE_UNPACKED_BYTES: Final = 16 << 20
"""Unpacked size of a 3MF archive, in bytes, up to which any compression ratio is accepted; larger
archives with a high ratio are refused as zip bombs."""
MAX_COMPRESSION_RATIO: Final = 100
"""Maximum ratio of unpacked to packed size of a large 3MF archive; with a higher one it is refused
as a zip bomb."""
MAX_INSTANCES: Final = 20_000
"""Maximum number of placed meshes of a 3MF model, nested components included; a model with more is
refused."""
RELATIONSHIPS: Final = "_rels/.rels"
"""Name of the file in a 3MF archive that states which of its models is the main one (Open Packaging
Conventions)."""
MAIN_MODEL: Final = re.compile(rb"<[^<>]*/3dmodel[\"'][^<>]*>")
TARGET: Final = re.compile(rb"\bTarget\s*=\s*[\"']/?([^\"'<>]*)")
MATERIAL_TYPES: Final = ("model", "surface")
"""Types of objects in a 3MF model that are solid material; objects of other types (supports) are
left out."""
CURA_ROLES: Final = frozenset(
    f"cura:{role}" for role in ("infill_mesh", "cutting_mesh", "support_mesh", "anti_overhang_mesh")
)
"""Names of the settings by which the slicer Cura marks objects of a 3MF model as modifiers, cutters
or supports, which are no material."""
UNBUILT: Final = "objects that are not part of the build were ignored."
UNPRINTED_IGNORED: Final = "parts that are not printed were ignored."
LEFT_OUT: Final = (
    "cutters, modifiers and supports were ignored, because they are not part of the solid."
)
SLICER_CONFIGS: Final = ("Metadata/Slic3r_PE_model.config", "Metadata/model_settings.config")
"""Files in a 3MF archive in which PrusaSlicer and slicers derived from it state the role of each
part (material, modifier or support)."""
ACCEPTED_EXTENSION_PARTS: Final = ("/production/", "/material/", "/trianglesets/")
"""Parts of the URIs of 3MF extensions that the reader supports, or that do not affect the geometry;
models that require other extensions are refused."""
OTHER_FORMS: Final = {
    "beam": "beams",
    "ball": "lattices of balls",
    "booleanshape": "Boolean combinations of meshes",
    "levelset": "shapes given by functions",
    "displacementmesh": "displaced meshes",
}
CORE: Final = "/3dmanufacturing/core/"
"""Part of the XML namespace of 3MF's core elements; other namespaces are extensions."""
IDENTITY: Final = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)

Key = tuple[str, str]


@dataclass(slots=True, kw_only=True)
class _Object:
    """An object of a model: its own mesh, or parts that are objects too.

    Attributes:
        kind: Its type; other types than ``model`` and ``surface`` are no material.
        points, corners: The mesh.
        parts: Objects that it consists of, and where they are.
        cutters: First and last triangles of the mesh that are no material.
    """

    kind: str
    points: list[tuple[float, float, float]] = field(
        default_factory=list[tuple[float, float, float]]
    )
    corners: list[tuple[int, int, int]] = field(default_factory=list[tuple[int, int, int]])
    parts: list[tuple[Key, Array]] = field(default_factory=list[tuple[Key, Array]])
    cutters: list[tuple[int, int]] = field(default_factory=list[tuple[int, int]])


def is_zip(data: bytes) -> bool:
    """Return True if the bytes begin with the signature of zip archives."""
    return data.startswith(ZIP_MAGIC)


def read_threemf(data: bytes, source: Source) -> Solid:
    """Return the solid in a 3MF archive.

    Raises:
        InputError: The archive is no 3MF model, a zip bomb or damaged, or the mesh is no solid.
    """
    # compressed data may hold some signatures by accident
    if (entries := data.count(ZIP_ENTRY)) > 2 * MAX_ENTRIES:
        raise _too_many_entries(entries)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = _models(archive)
            models = _Models(source)
            for name in names:
                models.read(archive, name)
            for entry in archive.infolist():
                if entry.filename in SLICER_CONFIGS:
                    models.read_roles(archive, entry.filename, names[0])
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError) as error:
        raise _damaged(f"the archive is broken ({quote(str(error))})") from error
    except (NotImplementedError, RuntimeError) as error:
        raise InputError(
            "unsupported", f"the archive's compression is not supported ({quote(str(error))})."
        ) from error
    except KeyError as error:
        raise _damaged(f"the model lacks {quote(str(error))}") from error
    except (ValueError, IndexError, OverflowError, struct.error) as error:
        raise _damaged(f"the model is broken ({error})") from error
    except LookupError as error:
        raise _damaged("the model's XML has an unknown encoding") from error
    return models.solid()


def _damaged(problem: str) -> InputError:
    return InputError("damaged", f"{problem}; export the model again as 3MF.")


def _too_many_entries(count: int) -> InputError:
    return InputError(
        "too-large",
        f"got {count} files in the archive, expected at most {MAX_ENTRIES}; export the model alone "
        "as 3MF.",
    )


def _models(archive: zipfile.ZipFile) -> list[str]:
    """Return the names of the archive's models, the main one first; refuse zip bombs."""
    entries = archive.infolist()
    if len(entries) > MAX_ENTRIES:
        raise _too_many_entries(len(entries))
    models = [e for e in entries if e.filename.lower().endswith(".model")]
    if not models and any(e.filename.endswith(".npy") for e in entries):
        raise InputError(
            "wrong-kind",
            "this looks like a NumPy archive (.npz), expected one array; save it with numpy.save.",
        )
    if not models:
        raise InputError(
            "wrong-kind",
            "this looks like a zip archive without a 3MF model; unpack it and send the mesh "
            "it contains.",
        )
    if any(e.flag_bits & 1 for e in models):
        raise InputError("unsupported", "the archive is encrypted; export it without a password.")
    unpacked = sum(e.file_size for e in models)
    packed = sum(e.compress_size for e in models)
    if unpacked > MAX_UNPACKED_BYTES or _is_bomb(unpacked, packed):
        raise _bomb(unpacked, packed)
    if len({e.filename.strip("/").lower() for e in models}) < len(models):
        raise _damaged("the archive has two models with the same name")
    main = _main_model(archive)
    names = [e.filename for e in sorted(models, key=lambda e: e.filename.count("/"))]
    return sorted(names, key=lambda name: name.lower() != main)


def _main_model(archive: zipfile.ZipFile) -> str:
    """Return the name, in small letters, of the model that the archive is about; may be empty."""
    if RELATIONSHIPS not in archive.namelist():
        return ""
    with archive.open(RELATIONSHIPS) as stream:
        text = stream.read(1 << 16)  # one takes about 200
    relation = MAIN_MODEL.search(text)
    target = TARGET.search(relation[0]) if relation else None
    return target[1].decode("utf-8", "replace").lower() if target else ""


def _is_bomb(unpacked: int, packed: int) -> bool:
    return unpacked > FREE_UNPACKED_BYTES and unpacked > MAX_COMPRESSION_RATIO * max(packed, 1)


def _bomb(unpacked: int, packed: int) -> InputError:
    return InputError(
        "bomb",
        f"{packed} bytes unpack to more than {unpacked} bytes, which is not plausible for a "
        "mesh; export the model again.",
    )


class _Models:
    """The objects and the build items of an archive's models."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._objects: dict[Key, _Object] = {}
        self._items: list[tuple[Key, Array]] = []
        self._unprinted: list[Key] = []
        self._role: list[str] = []
        self._name = ""
        self._now: _Object | None = None
        self._triangles = 0
        self._unpacked = 0
        self._units: set[str] = set()
        self._is_root = True
        self._prefixes = {""}
        self._notes: dict[str, None] = {}
        self._volume: tuple[int, int] | None = None

    def read(self, archive: zipfile.ZipFile, name: str) -> None:
        """Parse one model piece by piece."""
        self._name, self._now = name.strip("/").lower(), None
        self._is_root = not self._units
        self._parse(archive, name, self._start)

    def read_roles(self, archive: zipfile.ZipFile, name: str, model: str) -> None:
        """Parse a slicer's list of parts that cut, modify or support others."""
        self._name, self._now = model.strip("/").lower(), None
        self._volume = None
        self._parse(archive, name, self._start_role)

    def _parse(
        self,
        archive: zipfile.ZipFile,
        name: str,
        start: Callable[[str, dict[str, str]], None],
    ) -> None:
        self._parser = parser = expat.ParserCreate()
        parser.StartElementHandler = start
        parser.StartDoctypeDeclHandler = self._refuse_doctype
        packed = archive.getinfo(name).compress_size
        unpacked = 0
        try:
            with archive.open(name) as stream:
                while piece := stream.read(1 << 18):
                    unpacked += len(piece)
                    self._unpacked += len(piece)
                    if self._unpacked > MAX_UNPACKED_BYTES or _is_bomb(unpacked, packed):
                        raise _bomb(self._unpacked, packed)
                    parser.Parse(piece, False)
                parser.Parse(b"", True)
        except expat.ExpatError as error:
            raise _damaged(f"the model's XML is broken ({quote(str(error))})") from error

    def _refuse_doctype(self, *_: Any) -> None:
        raise _damaged("the model's XML declares a document type, which no 3MF model does")

    def _start_role(self, tag: str, fields: dict[str, str]) -> None:
        match tag:
            case "object":
                self._now = self._objects.get((self._name, fields.get("id", "")))
            case "volume":
                self._volume = parse_int(fields["firstid"]), parse_int(fields["lastid"])
            case "part":
                self._volume = None
                if fields.get("subtype", "normal_part") != "normal_part":
                    self._leave_out(fields.get("id", ""))
            case "metadata" if self._volume is not None and self._now is not None:
                key, value = fields.get("key"), fields.get("value")
                if (key == "volume_type" and value != "ModelPart") or (
                    key == "modifier" and value == "1"
                ):
                    self._now.cutters.append(self._volume)
            case _:
                pass

    def _leave_out(self, number: str) -> None:
        """Leave out the components of an assembly with this number."""
        parts = {key for key, _ in self._now.parts if key[1] == number} if self._now else set()
        for key in parts or {key for key in self._objects if key[1] == number}:
            if key in self._objects:
                self._objects[key].kind = "other"

    def _check_model(self, fields: dict[str, str]) -> None:
        """Refuse unsupported required extensions and models of several units."""
        self._units.add(fields.get("unit", "millimeter"))
        if len(self._units) > 1:
            units = " and ".join(sorted(map(quote, self._units)))
            raise InputError(
                "unsupported",
                f"got models in {units}, expected one unit; export all parts in the same unit.",
            )
        names = {k.partition(":")[2]: v for k, v in fields.items() if k.startswith("xmlns")}
        core = {prefix for prefix, name in names.items() if CORE in name}
        self._prefixes = core or {""}
        for prefix in fields.get("requiredextensions", "").split():
            name = names.get(prefix, prefix)
            if not any(word in name.lower() for word in ACCEPTED_EXTENSION_PARTS):
                name = name.rpartition("/3dmanufacturing/")[2]
                raise InputError(
                    "unsupported",
                    f"the model requires the extension {quote(name)!r}, which is not supported; "
                    "export it without this extension.",
                )

    def _start(self, tag: str, fields: dict[str, str]) -> None:
        if self._role:
            self._take_role()
        prefix, _, tag = tag.rpartition(":")
        if tag == "model":
            self._check_model(fields)
        elif prefix not in self._prefixes and tag not in OTHER_FORMS:
            return  # an extension's element, named like a core element
        match tag:
            case "vertex" if self._now is not None:
                x, y, z = fields["x"], fields["y"], fields["z"]
                point = parse_float(x), parse_float(y), parse_float(z)
                self._now.points.append(point)
            case "triangle" if self._now is not None:
                first, second, third = fields["v1"], fields["v2"], fields["v3"]
                corners = parse_int(first), parse_int(second), parse_int(third)
                if max(corners) >= 1 << 31:
                    raise ValueError("a vertex number that is too large")
                self._now.corners.append(corners)
                self._triangles += 1
                check_triangles(self._triangles, self._source.max_triangles)
            case "object":
                self._now = _Object(kind=fields.get("type", "model"))
                self._objects[self._name, fields["id"]] = self._now
            case "component" if self._now is not None:
                self._now.parts.append(self._reference(fields))
            case "item" if self._is_root:
                printable = next((v for k, v in fields.items() if k.endswith("printable")), "1")
                if printable.strip().lower() in ("0", "false"):
                    self._notes[UNPRINTED_IGNORED] = None
                    self._unprinted.append(self._reference(fields)[0])
                else:
                    self._items.append(self._reference(fields))
            case "metadata" if self._now is not None and fields.get("name") in CURA_ROLES:
                self._parser.CharacterDataHandler = self._role.append
            case "beam" | "ball" | "booleanshape" | "levelset" | "displacementmesh" as form:
                name = OTHER_FORMS[form]
                raise InputError(
                    "unsupported",
                    f"the model has {name}, which are not supported; export it as a mesh.",
                )
            case _:
                pass

    def _take_role(self) -> None:
        """Take the text of a role that Cura gives an object, which comes in pieces."""
        self._parser.CharacterDataHandler = None
        if self._now is not None and "".join(self._role).strip().lower() == "true":
            self._now.kind = "other"
        self._role.clear()

    def _reference(self, fields: dict[str, str]) -> tuple[Key, Array]:
        path = next((v for k, v in fields.items() if k.rpartition(":")[2] == "path"), "")
        words = fields.get("transform", "").split()
        numbers = [parse_float(word) for word in words] if words else IDENTITY
        if len(numbers) != 12 or not np.isfinite(numbers).all():
            raise ValueError("a transform that does not consist of twelve finite numbers")
        key = path.strip("/").lower() or self._name, fields["objectid"]
        return key, np.array(numbers).reshape(4, 3)

    def solid(self) -> Solid:
        """Return all built items as one solid."""
        if not self._items and UNPRINTED_IGNORED in self._notes:
            raise InputError(
                "empty", "no part of the model is printable; mark a part as printable."
            )
        inner = {key for model in self._objects.values() for key, _ in model.parts}
        items = self._items or [
            (key, np.array(IDENTITY).reshape(4, 3)) for key in self._objects if key not in inner
        ]
        totals: dict[Key, tuple[int, int]] = {}
        triangles = instances = 0
        for key, _ in items:
            part_total = self._amount(key, totals, 0)
            triangles, instances = triangles + part_total[0], instances + part_total[1]
        if instances > MAX_INSTANCES:
            raise InputError(
                "too-large",
                f"got {instances} parts, expected at most {MAX_INSTANCES}; join parts.",
            )
        check_triangles(triangles, self._source.max_triangles)
        points: list[Array] = []
        faces: list[Ints] = []
        rows = 0
        arrays: dict[Key, tuple[Array, Ints]] = {}
        waiting = list(items)
        while waiting:
            key, transform = waiting.pop()
            model = self._objects[key]
            if model.kind not in MATERIAL_TYPES:
                self._notes[LEFT_OUT] = None
                continue
            waiting += [
                (part, _after(part_transform, transform)) for part, part_transform in model.parts
            ]
            if not model.corners:
                continue
            if key not in arrays:
                arrays[key] = (
                    np.array(model.points, dtype=np.float64).reshape(-1, 3),
                    self._material(model),
                )
            vertices, corners = arrays[key]
            if not len(corners):
                continue
            if corners.min() < 0 or corners.max() >= len(vertices):
                wrong = corners.min() if corners.min() < 0 else corners.max()
                raise InputError(
                    "bad-index",
                    f"a triangle uses vertex {wrong}, but there are {len(vertices)} vertices, "
                    "counted from 0; export the model again.",
                )
            with np.errstate(all="ignore"):
                points.append(vertices @ transform[:3] + transform[3])
                mirrored = np.linalg.det(transform[:3]) < 0
            faces.append((corners[:, ::-1] if mirrored else corners) + rows)
            rows += len(vertices)
        if not faces and LEFT_OUT in self._notes:
            raise InputError(
                "empty",
                "all parts are cutters, modifiers or supports; add a solid part.",
            )
        check_triangles(len(faces), self._source.max_triangles)
        self._note_unbuilt([key for key, _ in items] + self._unprinted)
        return Solid.from_triangles(
            np.concatenate(points),
            np.concatenate(faces),
            name=self._source.name or "solid",
            notes=tuple(self._notes),
            max_triangles=self._source.max_triangles,
        )

    def _note_unbuilt(self, named: list[Key]) -> None:
        """Note that there are meshes that no item of the build consists of.

        Args:
            named: Objects that items name.
        """
        reached: set[Key] = set()
        waiting = list(named)
        while waiting:
            key = waiting.pop()
            if key in self._objects and key not in reached:
                reached.add(key)
                waiting += [part for part, _ in self._objects[key].parts]
        leftover_models = (model for key, model in self._objects.items() if key not in reached)
        if any(model.corners and model.kind in MATERIAL_TYPES for model in leftover_models):
            self._notes[UNBUILT] = None

    def _material(self, model: _Object) -> Ints:
        """Return the triangles of an object without those that cut, modify or support others."""
        corners = np.array(model.corners, dtype=np.int64)
        is_material = np.ones(len(corners), dtype=np.bool_)
        for first, last in model.cutters:
            is_material[max(first, 0) : max(last + 1, 0)] = False
        if not is_material.all():
            self._notes[LEFT_OUT] = None
        return corners[is_material]

    def _amount(self, key: Key, totals: dict[Key, tuple[int, int]], depth: int) -> tuple[int, int]:
        """Count the triangles and parts of an object without building them."""
        if key in totals:
            return totals[key]
        if key not in self._objects or depth > 64:  # one that contains itself is deeper, too
            problem = "parts nested too deeply" if key in self._objects else "a missing object"
            raise _damaged(f"the model refers to {problem}")
        model = self._objects[key]
        triangles, instances = len(model.corners), 1
        for part, _ in model.parts:
            part_total = self._amount(part, totals, depth + 1)
            triangles, instances = triangles + part_total[0], instances + part_total[1]
        totals[key] = triangles, instances
        return totals[key]


def _after(inner: Array, outer: Array) -> Array:
    """Return the composition of two transforms of row vectors, the inner one first."""
    with np.errstate(all="ignore"):
        return np.vstack([inner[:3] @ outer[:3], inner[3] @ outer[:3] + outer[3]])
