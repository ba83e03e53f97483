"""Modified plans for tests."""

from dataclasses import replace
from typing import Any

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.certificate.certificate import certify
from foldback.planner.chain.chain import Chain
from foldback.planner.motion.motion import FRAME_COLUMNS, Motion
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.plan.plan import Plan


def with_values(plan: Plan, **values: Any) -> Plan:
    """Return the plan with other values, which may include columns of its frames."""
    columns = {name: values.pop(name) for name in list(values) if name in FRAME_COLUMNS}
    if columns:
        values["motion"] = plan.whole().with_columns(**columns)
    return replace(plan, **values)


def unverified(chain: Chain, motion: Motion, parameters: Parameters) -> Plan:
    """Return a plan of any motion, with a certificate that states that nothing was checked."""
    certificate = certify(chain, None, None, parameters)
    plan = Plan.assembled(chain, parameters, 0, None, None, certificate)
    return replace(plan, motion=motion, max_error_rad=np.full(len(motion), np.nan))


def resting(chain: Chain, rests_rad: Array, *, frames_per_step: int = 4) -> Plan:
    """Return a plan that rests at some poses, with equal frames between; nothing is checked.

    Args:
        chain: The chain.
        rests_rad: (R, J) joint angles of the rests, from straight to folded.
        frames_per_step: Number of frames from one rest to the next.
    """
    count = len(rests_rad) - 1
    at = np.arange(count * frames_per_step + 1) / frames_per_step
    angles = np.array([np.interp(at, np.arange(count + 1), hinge) for hinge in rests_rad.T]).T
    motion = Motion.from_angles(angles)
    plan = unverified(chain, motion, Parameters())
    rests = np.arange(0, len(at), frames_per_step).tolist()
    return replace(plan, playback={"status": "folded", "rest_frames": rests})


def turn_by_turn(chain: Chain, at_once: int) -> Array:
    """Return the rests of a fold of so many hinges at once, from the middle of the chain on."""
    bent = np.flatnonzero(chain.folded_rad)
    order = bent[np.argsort(np.abs(bent - len(chain.folded_rad) / 2), kind="stable")]
    rests = [np.zeros_like(chain.folded_rad)]
    for k in range(0, len(order), at_once):
        rests.append(rests[-1].copy())
        rests[-1][order[k : k + at_once]] = chain.folded_rad[order[k : k + at_once]]
    return np.array(rests)
