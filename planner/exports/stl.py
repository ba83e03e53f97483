"""STL: the outer solid of one module, in millimetres as printers expect."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from foldback.planner.chain.module import Module
from foldback.planner.plan.plan import Plan

if TYPE_CHECKING:
    from trimesh import Trimesh

STL_HEADER: Final = b"foldback: the outer solid of one module, in millimetres".ljust(80)


def write(plan: Plan) -> bytes:
    """Return the module's hull at the size that the plan was verified for, as binary STL.

    It is centred as the module's frame is. It has no joints: how a hinge is made is up to who
    builds it.
    """
    from trimesh.exchange.stl import export_stl

    edge = plan.certificate.module_size * plan.chain.pitch_m * 1000.0  # mm, as slicers assume
    return STL_HEADER + export_stl(hull_of(plan.chain.module, edge))[len(STL_HEADER) :]


def hull_of(module: Module, size: float) -> Trimesh:
    """Return the outside of a module, its triangles counter-clockwise seen from outside.

    Args:
        module: The kind of module.
        size: Scale about the module's centre; 1 for the full hull, a pitch long.
    """
    from trimesh.convex import convex_hull  # only who exports a mesh needs it

    return convex_hull(module.vertices).apply_scale(size)
