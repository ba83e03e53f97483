"""Modules from URDF: two links and the joint between them become a ``foldback-module/1`` object.

In a chain, the second body of a module is fixed to the first body of the next module, face to face
along the axis on which the two bodies lie. The XML may be a stranger's: it has no document type,
few elements, and names of meshes are looked up among the given files only.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final
from xml.parsers import expat

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.display_names import clean_name
from foldback.planner.chain.module_file import MAX_CORNERS, MODULE_FORMAT
from foldback.planner.chain.rotations import axis_rotation
from foldback.planner.errors import InputError
from foldback.planner.readers.limits import megabytes, parse_float, quote

MAX_URDF_BYTES: Final = 1 << 20
"""Maximum size of a URDF file, in bytes; one with two links has a few thousand."""
MAX_ELEMENTS: Final = 2_000
"""Maximum number of XML elements of a URDF file."""
MAX_DEPTH: Final = 20
"""Maximum depth of nested XML elements of a URDF file; that of a box in a link is five."""
CYLINDER_SIDES: Final = 12
"""Number of side faces of the prism around a cylinder."""
CONVEX_SHARE: Final = 1e-3
"""Share of the volume of its hull up to which a collision mesh may lack volume, because its corners
are rounded numbers."""
ROUNDED_DIGITS: Final = 9
"""Number of decimal places of the lengths, in pitches, of a module that is read."""


@dataclass(slots=True)
class Element:
    """An XML element with its attributes and children."""

    tag: str
    fields: dict[str, str]
    children: list[Element] = field(default_factory=list["Element"])

    def all(self, tag: str) -> list[Element]:
        """Return its children of a kind."""
        return [child for child in self.children if child.tag == tag]

    def first(self, tag: str) -> Element | None:
        """Return its first child of a kind, or None."""
        return next(iter(self.all(tag)), None)


def read_urdf(data: bytes, meshes: Mapping[str, bytes] | None = None) -> dict[str, Any]:
    """Return the ``foldback-module/1`` object of a URDF file with two links and a joint.

    Args:
        data: The whole file.
        meshes: Collision meshes by the last part of their names; no others are read.

    Raises:
        InputError: The file cannot be used; names the element.
    """
    robot = _parse(data)
    links = {link.fields.get("name", ""): link for link in robot.all("link")}
    joints = robot.all("joint")
    if (len(robot.all("link")), len(joints)) != (2, 1):
        raise _bad(
            f"got {len(robot.all('link'))} links and {len(joints)} joints, expected two links and "
            "the joint between them; remove the others",
            "robot",
        )
    (joint,) = joints
    first, second = (_link(joint, links, tag) for tag in ("parent", "child"))
    turn, at = _origin(joint)
    bodies = [_body(first, meshes or {}), [p @ turn.T + at for p in _body(second, meshes or {})]]
    return _document(robot, joint, [first, second], bodies, turn, at)


def _parse(data: bytes) -> Element:
    """Return the root element."""
    if len(data) > MAX_URDF_BYTES:
        raise InputError(
            "too-large",
            f"got {megabytes(len(data))}, expected a URDF file of at most "
            f"{megabytes(MAX_URDF_BYTES)}.",
        )
    top = Element("", {})
    open_elements, count = [top], 0

    def start(tag: str, fields: dict[str, str]) -> None:
        nonlocal count
        count += 1
        if count > MAX_ELEMENTS or len(open_elements) > MAX_DEPTH:
            raise _bad(
                f"got more than {MAX_ELEMENTS} elements, or elements nested more than {MAX_DEPTH} "
                "deep, expected two links and a joint",
                "robot",
            )
        element = Element(tag, fields)
        open_elements[-1].children.append(element)
        open_elements.append(element)

    def end(_: str) -> None:
        open_elements.pop()

    def refuse_doctype(*_: Any) -> None:
        raise _bad("got a document type, which no URDF file needs; remove it", "<!DOCTYPE>")

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.StartDoctypeDeclHandler = refuse_doctype
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise InputError(
            "bad-urdf",
            f"this is not valid XML ({quote(str(error))}); save the URDF file again.",
        ) from error
    robot = top.first("robot")
    if robot is None:
        tag = quote(top.children[0].tag)
        raise _bad(f"got the element <{tag}>, expected <robot>", tag)
    if any(":" in child.tag for child in robot.children):
        raise _bad("got xacro macros; run xacro first, and give its output", "robot")
    return robot


def _link(joint: Element, links: Mapping[str, Element], tag: str) -> Element:
    """Return the link that a joint names as its parent or child."""
    named = joint.first(tag)
    name = "" if named is None else named.fields.get("link", "")
    if name not in links:
        raise _bad(
            f"got the {tag} link {quote(name)!r}, expected one of: "
            f"{', '.join(quote(link) for link in links)}",
            f"joint/{tag}",
        )
    return links[name]


def _numbers(element: Element, key: str, count: int, default: str | None = None) -> Array:
    """Return the numbers of an attribute."""
    text = element.fields.get(key, default)
    place = f"{element.tag}/{key}"
    if text is None:
        raise _bad(f"got none, expected {count} numbers", place)
    try:
        values = np.array([parse_float(word) for word in text.split()])
    except ValueError as error:
        raise _bad(str(error), place) from error
    if len(values) != count or not np.isfinite(values).all() or np.abs(values).max() > 1e3:
        raise _bad(f"got {quote(text)!r}, expected {count} numbers up to 1000", place)
    return values


def _origin(element: Element) -> tuple[Array, Array]:
    """Return the rotation (roll about x, then pitch about y, then yaw about z) and the place."""
    origin = element.first("origin")
    if origin is None:
        return np.eye(3), np.zeros(3)
    roll, pitch, yaw = _numbers(origin, "rpy", 3, "0 0 0")
    x, y, z = np.eye(3)
    turn = axis_rotation(z, yaw) @ axis_rotation(y, pitch) @ axis_rotation(x, roll)
    return turn, _numbers(origin, "xyz", 3, "0 0 0")


def _body(link: Element, meshes: Mapping[str, bytes]) -> list[Array]:
    """Return the corners of each collision body of a link, in its frame, in metres."""
    place = f"link {quote(link.fields.get('name', ''))!r}"
    bodies = link.all("collision") or link.all("visual")
    if not bodies:
        raise _bad("got a link without a collision body, expected a box or a mesh", place)
    parts: list[Array] = []
    for body in bodies:
        turn, at = _origin(body)
        geometry = body.first("geometry")
        shape = next(iter(geometry.children), None) if geometry is not None else None
        if shape is None:
            raise _bad("got a body without a geometry, expected a box or a mesh", place)
        parts.append(_corners(shape, meshes) @ turn.T + at)
    return parts


def _corners(shape: Element, meshes: Mapping[str, bytes]) -> Array:
    """Return the corners of a geometry, in metres."""
    if shape.tag == "box":
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        return signs * _numbers(shape, "size", 3) / 2.0
    if shape.tag == "cylinder":
        (radius,), (length,) = _numbers(shape, "radius", 1), _numbers(shape, "length", 1)
        angles = (np.arange(CYLINDER_SIDES) + 0.5) * 2.0 * np.pi / CYLINDER_SIDES
        rim = radius / np.cos(np.pi / CYLINDER_SIDES)
        return np.array(
            [
                [rim * np.cos(a), rim * np.sin(a), z]
                for z in (-length / 2.0, length / 2.0)
                for a in angles
            ]
        )
    if shape.tag != "mesh":
        raise _bad(
            f"got the geometry <{quote(shape.tag)}>, expected <box>, <cylinder> or <mesh>",
            "geometry",
        )
    name = re.split(r"[/\\]", shape.fields.get("filename", ""))[-1]
    if name not in meshes:
        raise _bad(
            f"got the mesh {quote(name)!r}, which is not among the given files; give it, too",
            "mesh/filename",
        )
    return _mesh_corners(meshes[name], name) * _numbers(shape, "scale", 3, "1 1 1")


def _mesh_corners(data: bytes, name: str) -> Array:
    """Return the corners of a convex mesh."""
    from scipy.spatial import ConvexHull, QhullError

    from foldback.planner.readers.formats import read
    from foldback.planner.shapes.solid import Solid, signed_volume

    solid = read(data, filename=name)
    if not isinstance(solid, Solid):
        raise _bad("got a file that is no mesh, expected an STL, OBJ, PLY or other mesh", name)
    points = np.unique(solid.vertices.round(9), axis=0)
    try:
        hull = ConvexHull(points)
    except QhullError as error:
        raise _bad("got a mesh without a volume, expected a convex body", name) from error
    volume = abs(signed_volume(solid.vertices, solid.faces))
    if volume < (1.0 - CONVEX_SHARE) * hull.volume:
        share = volume / hull.volume
        raise _bad(
            f"got a mesh that fills {share:.1%} of its convex hull, expected a convex body; split "
            "it into several collision bodies",
            name,
        )
    corners = points[_true_corners(hull.equations, hull.vertices, points)]
    if len(corners) > MAX_CORNERS:
        raise _bad(
            f"got a mesh with {len(corners)} corners, expected at most {MAX_CORNERS}; simplify it, "
            "or use a box",
            name,
        )
    return corners


def _true_corners(equations: Array, vertices: Any, points: Array) -> list[int]:
    """Return the vertices of a hull at which at least three of its planes meet."""
    tolerance = 1e-7 * float(np.ptp(points, axis=0).max())
    planes = np.unique(equations.round(6), axis=0)
    return [
        int(v)
        for v in vertices
        if np.linalg.matrix_rank(
            planes[np.abs(planes[:, :3] @ points[v] + planes[:, 3]) <= 10 * tolerance, :3], tol=1e-4
        )
        == 3
    ]


def _document(
    robot: Element,
    joint: Element,
    links: list[Element],
    bodies: list[list[Array]],
    turn: Array,
    at: Array,
) -> dict[str, Any]:
    """Return the module: the second body, and the first body of the next module behind it."""
    first, second = (np.concatenate(parts) for parts in bodies)
    between = (second.min(axis=0) + second.max(axis=0) - first.min(axis=0) - first.max(axis=0)) / 2
    along = int(np.abs(between).argmax())
    x = np.eye(3)[along] * (1.0 if between[along] >= 0.0 else -1.0)
    pitch = float(max((second @ x).max(), (first @ x).max()) - (first @ x).min())
    y = np.eye(3)[(along + 1) % 3]
    axes = np.stack([x, y, np.cross(x, y)], axis=1)
    parts = [*bodies[1], *(part + pitch * x for part in bodies[0])]
    joint_axis = joint.first("axis")
    axis = turn @ (_numbers(joint_axis, "xyz", 3) if joint_axis is not None else np.eye(3)[0])
    length = float(np.linalg.norm(axis))
    if length == 0.0:
        raise _bad("got an axis of length 0, expected one such as 0 0 1", "axis/xyz")
    local = axes.T @ axis / length
    name = clean_name(robot.fields.get("name", "")) or "module"
    return {
        "format": MODULE_FORMAT,
        "name": _program_name(name),
        "words": {"singular": f"{name} module"[:80], "plural": f"{name} modules"[:80]},
        "pieces": [
            {
                "name": "body",
                "parts": [{"corners": _rounded((part - at) @ axes / pitch)} for part in parts],
                "entry": {"at": [0.0, 0.0, 0.0]},
                "exit": {"at": [1.0, 0.0, 0.0]},
                "joint": {
                    "kind": "twist" if abs(local[0]) > 1.0 - 1e-6 else "hinge",
                    "hinges": [{"axis": _rounded(local), **_range(joint)}],
                },
            }
        ],
        "pattern": ["body"],
        "pitch_m": round(pitch, ROUNDED_DIGITS),
        **_figures(joint, links),
        "source": f"Read from the URDF of the robot {quote(name)}.",
    }


def _program_name(name: str) -> str:
    """Return a name with the characters that names of modules may have."""
    text = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")[:40].strip("-")
    return text if re.match(r"[a-z]", text) else f"m-{text}"[:40].strip("-")


def _rounded(values: Array) -> Any:
    return (np.round(values, ROUNDED_DIGITS) + 0.0).tolist()


def _range(joint: Element) -> dict[str, Any]:
    """Return the range of the hinge; none for a continuous joint."""
    kind, limit = joint.fields.get("type", ""), joint.first("limit")
    if kind == "continuous":
        return {}
    if kind != "revolute":
        raise _bad(
            f"got a joint of type {quote(kind)!r}, expected 'revolute' or 'continuous'",
            "joint/type",
        )
    if limit is None:
        raise _bad("got no limit, expected one for a revolute joint", "joint/limit")
    ends = [float(_numbers(limit, key, 1)[0]) for key in ("lower", "upper")]
    return {"range_deg": [round(float(np.rad2deg(end)), ROUNDED_DIGITS) for end in ends]}


def _figures(joint: Element, links: list[Element]) -> dict[str, float]:
    """Return mass, torque and speed, as far as the file has them."""
    masses = [
        float(_numbers(mass, "value", 1)[0])
        for link in links
        if (inertial := link.first("inertial")) is not None
        and (mass := inertial.first("mass")) is not None
    ]
    limit = joint.first("limit")
    limits = {} if limit is None else limit.fields
    figures = {"mass_kg": sum(masses) if len(masses) == len(links) else 0.0}
    for key, name in (("effort", "torque_nm"), ("velocity", "speed_rad_s")):
        figures[name] = (
            float(_numbers(limit, key, 1)[0]) if limit is not None and key in limits else 0.0
        )
    return {name: value for name, value in figures.items() if value > 0.0}


def _bad(text: str, place: str) -> InputError:
    return InputError("bad-urdf", f"{text}.", where=place)
