"""OBJ: the outer solid of one module, in metres, for robot models that name it as their mesh."""

from __future__ import annotations

from foldback.planner.exports.stl import hull_of
from foldback.planner.plan.plan import Plan


def write(plan: Plan) -> bytes:
    """Return the module's hull at the size that the plan was verified for, as a closed OBJ mesh."""
    hull = hull_of(plan.chain.module, plan.certificate.module_size * plan.chain.pitch_m)
    lines = ["# foldback: the outer solid of one module, in metres", "o module"]
    lines += ["v " + " ".join(map(repr, corner)) for corner in hull.vertices.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in hull.faces.tolist()]
    return ("\n".join(lines) + "\n").encode()
