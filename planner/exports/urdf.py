"""URDF: the chain as links and joints, for ROS and everything that reads its models. In SI units.

A link's frame has its module's orientation and sits at the hinge that ties it to its parent, as
URDF wants it; the module's centre is where its visual, collision and inertial origins are. The
tree's root is the chain's root module, whose frame is at its centre; the chain hangs off it both
ways. A universal joint is two revolute ones with a small link between them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final
from xml.etree import ElementTree  # nosec B405 (it writes, and reads nothing)

import numpy as np
from scipy.spatial.transform import Rotation

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import Module, Piece
from foldback.planner.exports.export import identifier
from foldback.planner.exports.obj import object_name
from foldback.planner.plan.plan import Plan
from foldback.planner.simulation.mujoco_models import hinge_names

MESH_FILE: Final = "module.obj"
"""File name of a module's mesh beside a URDF model, in metres, unless the module is a box. It is an
OBJ file, because Drake reads no STL for collisions and all other simulators read OBJ, too."""
DRAKE_NAMESPACE: Final = "https://drake.mit.edu"
HINGE_LINK_MASS_FRACTION: Final = 0.01
"""Mass of the link between two hinges of one joint, as a fraction of a module's mass. Simulators
reject links without mass."""
MIN_LINK_INERTIA_KG_M2: Final = 2e-14
"""Minimum moment of inertia of a link, kg·m². MuJoCo rejects less than 1e-14. Without the minimum,
the link between two hinges has 4.5e-15 for cubes of 1 mm, which have 4.5e-13 themselves.
Measured."""

NO_ROTATION_RPY: Final = np.zeros(3)
"""Roll, pitch and yaw, in rad, for the origin of a URDF element whose frame is parallel to its
parent's."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Side:
    """Joint between a module and the previous one on the way from the root.

    Attributes:
        rpy: (3,) its orientation in its parent's frame, straight: turns about the fixed axes x, y
            and z, in this order.
        anchor: (3,) the joint seen from the parent's centre, in pitches.
        axes: (K, 3) hinge axes in the module's own frame, nearest the root first.
    """

    rpy: Array
    anchor: Array
    axes: Array


def outward(module: Module, index: int) -> Side:
    """Return the joint by which module ``index`` + 1 hangs from module ``index``."""
    anchor, axes, turn, _ = module.link(index)
    return Side(rpy=_rpy(turn), anchor=anchor, axes=axes @ turn)


def inward(module: Module, index: int) -> Side:
    """Return the joint by which module ``index`` hangs from module ``index`` + 1."""
    _, axes, turn, offset = module.link(index)
    return Side(rpy=_rpy(turn.T), anchor=-offset, axes=-axes[::-1])


def centre_of(chain: Chain, index: int) -> Array:
    """Return (3,) the module's centre in the frame of link ``module_<index>``, in metres."""
    if index == chain.root:
        return np.zeros(3)
    link = chain.module.link(index - 1 if index > chain.root else index)
    return (link.offset if index > chain.root else -link.anchor) * chain.pitch_m


def write(plan: Plan) -> bytes:
    """Return the plan's chain as URDF.

    Joints are named as in ``Chain.joint_names`` and come in that order. A module has the mass of a
    solid one. Parts that are boxes are boxes; a piece with another part is the mesh ``module.obj``,
    which is an export of its own: of a module of several pieces, each object of it is a file of its
    own here, ``<piece>.obj``.
    Limits of effort and speed are the torque that holds the straight chain out against gravity, and
    the plan's joint speed. Linked modules overlap: Drake reads their pairs as collision filter
    groups here, others in the SRDF beside it. There is no ``encoding`` in the first line, so that
    parsers take the text as a string, too.
    """
    chain, module = plan.chain, plan.chain.module
    robot = ElementTree.Element(
        "robot", {"name": identifier(chain.name), "xmlns:drake": DRAKE_NAMESPACE}
    )
    # MuJoCo would otherwise merge fixed links, whose names an SRDF refers to.
    extension = ElementTree.SubElement(robot, "mujoco")
    ElementTree.SubElement(extension, "compiler", fusestatic="false")
    mass = float(plan.parameters["density_kg_m3"]) * module.volume * chain.pitch_m**3
    limit = {
        "effort": repr(plan.certificate.gravity_torque_straight_nm),
        "velocity": repr(plan.certificate.joint_speed_limit_rad_s),
    }
    size = plan.certificate.module_size
    masses = (mass * module.masses(len(chain))).tolist()
    _add_module(robot, chain, chain.root, masses[chain.root], size)
    joints: dict[str, ElementTree.Element] = {}
    for i in (*range(chain.root + 1, len(chain)), *range(chain.root - 1, -1, -1)):
        parent = i - 1 if i > chain.root else i + 1
        hinges = len(hinge_names(chain, min(i, parent)))
        share = 1.0 - HINGE_LINK_MASS_FRACTION * max(0, hinges - 1)
        _add_module(robot, chain, i, masses[i] * share, size)
        joints |= _linked(robot, chain, parent, i, masses[i] * HINGE_LINK_MASS_FRACTION, limit)
    order = {name: k for k, name in enumerate(chain.joint_names)}
    robot.extend(joints[name] for name in sorted(joints, key=lambda name: order.get(name, -1)))
    _add_filter_groups(robot, chain)
    return xml_bytes(robot)


def xml_bytes(root: ElementTree.Element) -> bytes:
    """Return a document as UTF-8, without an ``encoding`` in its declaration."""
    ElementTree.indent(root)
    return f'<?xml version="1.0"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'.encode()


def _linked(
    robot: ElementTree.Element,
    chain: Chain,
    parent: int,
    index: int,
    hinge_mass: float,
    limit: dict[str, str],
) -> dict[str, ElementTree.Element]:
    """Return the joints by name that tie a module to its parent; add the links between them."""
    outwards = index > parent
    before, order = min(index, parent), 1 if outwards else -1
    side = (outward if outwards else inward)(chain.module, before)
    names = hinge_names(chain, before)[::order]
    ranges = chain.module.ranges_behind(before)[::order].tolist()
    links = [f"module_{parent}", *(f"hinge_{name}" for name in names[:-1]), f"module_{index}"]
    for name in links[1:-1]:
        link = ElementTree.SubElement(robot, "link", name=name)
        inertia = chain.module.piece(parent).inertia * (hinge_mass * chain.pitch_m**2)
        _add_inertial(link, np.zeros(3), hinge_mass, inertia)
    anchor = centre_of(chain, parent) + side.anchor * chain.pitch_m
    if not names:
        name = f"rigid_{min(index, parent)}"
        return {name: _joint(name, "fixed", links[0], links[1], anchor, side.rpy)}
    joints: dict[str, ElementTree.Element] = {}
    for k, name in enumerate(names):
        origin, rpy = (anchor, side.rpy) if k == 0 else (np.zeros(3), NO_ROTATION_RPY)
        low, high = ranges[k]
        has_range = math.isfinite(low)
        kind = "revolute" if has_range else "continuous"
        joint = _joint(name, kind, links[k], links[k + 1], origin, rpy)
        ElementTree.SubElement(joint, "axis", xyz=_numbers(side.axes[k]))
        ends = {"lower": repr(low), "upper": repr(high)} if has_range else {}
        ElementTree.SubElement(joint, "limit", ends | limit)
        joints[name] = joint
    return joints


def _add_filter_groups(robot: ElementTree.Element, chain: Chain) -> None:
    """Add Drake's collision filter groups: one for each exempt pair, which ignores itself."""
    for i, j in chain.module.exempt_pairs(len(chain)):
        name = f"linked_{i}_{j}"
        group = ElementTree.SubElement(robot, "drake:collision_filter_group", name=name)
        for index in (i, j):
            ElementTree.SubElement(group, "drake:member", link=f"module_{index}")
        ElementTree.SubElement(group, "drake:ignored_collision_filter_group", name=name)


def _add_module(
    robot: ElementTree.Element, chain: Chain, index: int, mass: float, module_size: float
) -> None:
    link = ElementTree.SubElement(robot, "link", name=f"module_{index}")
    centre = centre_of(chain, index)
    inertia = chain.module.piece(index).inertia * (mass * chain.pitch_m**2)
    _add_inertial(link, centre, mass, inertia)
    piece, scale = chain.module.piece(index), module_size * chain.pitch_m
    for kind in ("visual", "collision"):
        if needs_mesh(piece):
            name = MESH_FILE if len(chain.module.pieces) == 1 else f"{object_name(piece)}.obj"
            ElementTree.SubElement(_add_shape(link, kind, centre), "mesh", filename=name)
            continue
        for part in piece.parts:
            middle, half = part.box or (np.zeros(3), np.zeros(3))
            geometry = _add_shape(link, kind, centre + scale * middle)
            ElementTree.SubElement(geometry, "box", size=_numbers(scale * 2.0 * half))


def needs_mesh(piece: Piece) -> bool:
    """Return True if a part of a piece is no box, so that a model names a file with its mesh."""
    return any(part.box is None for part in piece.parts)


def _add_shape(link: ElementTree.Element, kind: str, origin: Array) -> ElementTree.Element:
    """Add a visual or collision element to a link; return its geometry."""
    element = ElementTree.SubElement(link, kind)
    _add_origin(element, origin)
    return ElementTree.SubElement(element, "geometry")


def _add_inertial(link: ElementTree.Element, centre: Array, mass: float, moments: Array) -> None:
    inertial = ElementTree.SubElement(link, "inertial")
    _add_origin(inertial, centre)
    ElementTree.SubElement(inertial, "mass", value=repr(mass))
    ixx, iyy, izz = np.maximum(moments, MIN_LINK_INERTIA_KG_M2).tolist()
    inertia = {"ixx": ixx, "ixy": 0.0, "ixz": 0.0, "iyy": iyy, "iyz": 0.0, "izz": izz}
    ElementTree.SubElement(inertial, "inertia", {k: repr(v) for k, v in inertia.items()})


def _joint(
    name: str, kind: str, parent: str, child: str, origin: Array, rpy: Array
) -> ElementTree.Element:
    joint = ElementTree.Element("joint", name=name, type=kind)
    _add_origin(joint, origin, rpy)
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    return joint


def _add_origin(element: ElementTree.Element, xyz: Array, rpy: Array = NO_ROTATION_RPY) -> None:
    ElementTree.SubElement(element, "origin", xyz=_numbers(xyz), rpy=_numbers(rpy))


def _rpy(turn: Array) -> Array:
    return Rotation.from_matrix(turn).as_euler("xyz")


def _numbers(values: Array) -> str:
    return " ".join(repr(value) for value in (values + 0.0).tolist())
