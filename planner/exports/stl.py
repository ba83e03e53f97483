"""STL: the outer solid of one module, in millimetres as printers expect."""

from __future__ import annotations

from typing import Final

import numpy as np

from planner.exports.hull import hull_triangles, normals_of
from planner.plan.plan import Plan

MILLIMETRES: Final = 1000.0
"""In a metre."""
HEADER: Final = b"foldback: the outer solid of one module, in millimetres"
FACET: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def write(plan: Plan) -> bytes:
    """The module's hull at the size that the plan was verified for, as binary STL.

    It is centred as the module's frame is. It has no joints: how a hinge is made is up to who
    builds it.
    """
    edge = plan.certificate.module_size * plan.chain.pitch_m * MILLIMETRES
    triangles = hull_triangles(plan.chain.module, edge)
    facets = np.zeros(len(triangles), dtype=FACET)
    facets["normal"], facets["corners"] = normals_of(triangles), triangles
    return HEADER.ljust(80) + np.uint32(len(facets)).astype("<u4").tobytes() + facets.tobytes()
