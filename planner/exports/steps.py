"""Step document: the turns of a fold as JSON, in the format ``foldback-steps/1``: docs/steps.md."""

from __future__ import annotations

import json
from typing import Any, Final

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import Poses
from foldback.planner.exports.export import export_name, require_frames
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.step_text import step_text
from foldback.planner.plan.steps import Steps, Turn, hinge_axis, steps_of

STEPS_FORMAT: Final = "foldback-steps/1"


def write(plan: Plan) -> bytes:
    """Return the steps of a plan as JSON text.

    Raises:
        InputError: ``no-frames``, or ``no-steps`` if the plan does not rest between steps.
    """
    require_frames(plan)
    return (json.dumps(step_document(steps_of(plan)), indent=1, ensure_ascii=False) + "\n").encode()


def step_document(steps: Steps) -> dict[str, Any]:
    """Return the step document as plain JSON values."""
    chain = steps.chain
    poses = steps.poses()
    return {
        "format": STEPS_FORMAT,
        "name": export_name(chain.name),
        "module": chain.module.name,
        "modules": len(chain),
        "pitch_m": chain.pitch_m,
        "turns": steps.turn_count,
        "steps": [
            {
                "number": step.number,
                "text": step_text(chain.module, step),
                "start_frame": steps.frames[k],
                "end_frame": steps.frames[k + 1],
                "start_s": _rounded(steps.times_s[k]),
                "duration_s": _rounded(steps.times_s[k + 1] - steps.times_s[k]),
                "merged": len(step.turns) > 1,
                "held": list(step.held),
                "moving": [list(part) for part in step.moving],
                "turns": [_turn(chain, turn, poses[k]) for turn in step.turns],
            }
            for k, step in enumerate(steps.steps)
        ],
    }


def _turn(chain: Chain, turn: Turn, poses: Poses) -> dict[str, Any]:
    axis, pivot = hinge_axis(chain.module, turn, poses)
    return {
        "joint": chain.joint_names[turn.hinge],
        "hinge": turn.hinge,
        "module": turn.module,
        "moves": list(turn.moves),
        "from_rad": turn.from_rad,
        "to_rad": turn.to_rad,
        "from_deg": _rounded(np.rad2deg(turn.from_rad)),
        "to_deg": _rounded(np.rad2deg(turn.to_rad)),
        "axis": [_rounded(value) for value in axis],
        "pivot": [_rounded(value) for value in pivot],
    }


def _rounded(value: float) -> float:
    return round(float(value), 9) + 0.0  # no negative zero
