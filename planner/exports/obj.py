"""OBJ: the outer solids of one module, in metres, for robot models that name it as their mesh."""

from __future__ import annotations

from foldback.planner.chain.module import Piece
from foldback.planner.exports.stl import piece_mesh
from foldback.planner.plan.plan import Plan


def write(plan: Plan) -> bytes:
    """Return the module at the size that the plan was verified for, as closed OBJ meshes.

    Each of its pieces is an object, in the frame of the piece.
    """
    module = plan.chain.module
    lines = ["# foldback: the outer solid of one module, in metres"]
    first = 1
    for piece in module.pieces:
        mesh = piece_mesh(piece, plan.certificate.module_size * plan.chain.pitch_m)
        lines.append(f"o {object_name(piece) if len(module.pieces) > 1 else 'module'}")
        lines += ["v " + " ".join(map(repr, corner)) for corner in mesh.vertices.tolist()]
        lines += [f"f {' '.join(str(first + k) for k in face)}" for face in mesh.faces.tolist()]
        first += len(mesh.vertices)
    return ("\n".join(lines) + "\n").encode()


def object_name(piece: Piece) -> str:
    """Return the name of a piece's object: letters, digits and underscores."""
    return "".join(c if c.isascii() and c.isalnum() else "_" for c in piece.name)
