"""Modified plans for tests."""

from dataclasses import replace
from typing import Any

import numpy as np

from planner.certificate.certificate import certify
from planner.chain.chain import Chain
from planner.motion.motion import FRAME_COLUMNS, Motion
from planner.parameters.parameters import Parameters
from planner.plan.plan import Plan

LATER_FIGURES = (
    *("simulated", "exempt_pairs", "min_clearance_record_at", "frames", "plan_end_error_rad"),
    *("max_angle_rad", "max_angle_record_rad", "torque_source", "torque_frames"),
)
"""Fields that certificates of earlier versions did not have."""


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
