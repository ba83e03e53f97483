"""Motion: what every export of a moving chain asks of a plan."""

from __future__ import annotations

from planner.errors import InputError
from planner.plan.plan import Plan


def require_frames(plan: Plan) -> None:
    """Refuses a plan whose chain never moved.

    Raises:
        InputError: ``no-frames``.
    """
    if not len(plan.time_s):
        raise InputError(
            "no-frames", "the plan has no frames, expected some; its fold failed before playback."
        )
