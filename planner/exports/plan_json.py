"""JSON: the plan as ``foldback-plan/3``."""

from __future__ import annotations

from planner.plan.plan import Plan


def write(plan: Plan) -> bytes:
    """The plan as JSON text."""
    return plan.json_bytes()
