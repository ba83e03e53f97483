"""SRDF: the pairs of linked modules that collision checks skip, for MoveIt and others, beside URDF.

The pairs are those that ``model.xml`` excludes from contact, ``Module.exempt_pairs``. The root
floats, and all joints make one planning group.
"""

from __future__ import annotations

from typing import Final
from xml.etree import ElementTree  # nosec B405 (it writes, and reads nothing)

from foldback.planner.exports.export import identifier
from foldback.planner.exports.urdf import xml_bytes
from foldback.planner.plan.plan import Plan

GROUP: Final = "chain"


def write(plan: Plan) -> bytes:
    """Return the SRDF that belongs to the plan's URDF."""
    chain = plan.chain
    robot = ElementTree.Element("robot", name=identifier(chain.name))
    ElementTree.SubElement(
        robot,
        "virtual_joint",
        name="root",
        type="floating",
        parent_frame="world",
        child_link=f"module_{chain.root}",
    )
    group = ElementTree.SubElement(robot, "group", name=GROUP)
    for name in chain.joint_names:
        ElementTree.SubElement(group, "joint", name=name)
    for i, j in chain.module.exempt_pairs(len(chain)):
        links = {"link1": f"module_{i}", "link2": f"module_{j}"}
        ElementTree.SubElement(robot, "disable_collisions", links, reason="Adjacent")
    return xml_bytes(robot)
