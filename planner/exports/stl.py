"""STL: the outer solids of one module, in millimetres as printers expect."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, cast

from foldback.planner.chain.module import Piece
from foldback.planner.plan.plan import Plan

if TYPE_CHECKING:
    from trimesh import Trimesh

STL_HEADER: Final = b"foldback: the outer solid of one module, in millimetres".ljust(80)


def write(plan: Plan) -> bytes:
    """Return the module's parts at the size that the plan was verified for, as binary STL.

    They are centred as the module's frame is; of a module of several pieces, one of each lies
    beside the other. It has no joints: how a hinge is made is up to who builds it.
    """
    from trimesh.exchange.stl import export_stl
    from trimesh.util import concatenate

    module = plan.chain.module
    edge = plan.certificate.module_size * plan.chain.pitch_m * 1000.0  # mm, as slicers assume
    meshes = [
        piece_mesh(piece, edge).apply_translation([2.0 * k * module.radius * edge, 0.0, 0.0])
        for k, piece in enumerate(module.pieces)
    ]
    return STL_HEADER + export_stl(concatenate(meshes))[len(STL_HEADER) :]


def piece_mesh(piece: Piece, size: float) -> Trimesh:
    """Return the outsides of a piece's parts, triangles counter-clockwise seen from outside.

    Args:
        piece: The piece.
        size: Scale about the piece's centre; 1 for full size, with a pitch of 1.
    """
    from trimesh.convex import convex_hull  # only who exports a mesh needs it
    from trimesh.util import concatenate

    meshes = [convex_hull(part.corners).apply_scale(size) for part in piece.parts]
    return meshes[0] if len(meshes) == 1 else cast("Trimesh", concatenate(meshes))
