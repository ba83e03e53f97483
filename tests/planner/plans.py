"""Plans that somebody has changed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from planner.certificate.certificate import certify
from planner.chain.chain import Chain
from planner.motion.motion import FRAME_COLUMNS, Motion
from planner.parameters.parameters import Parameters
from planner.plan.plan import Plan


def changed(plan: Plan, **values: Any) -> Plan:
    """The plan with other values; columns of its frames may be among them."""
    columns = {name: values.pop(name) for name in list(values) if name in FRAME_COLUMNS}
    if columns:
        values["motion"] = plan.whole().with_columns(**columns)
    return replace(plan, **values)


def unverified(chain: Chain, motion: Motion, parameters: Parameters) -> Plan:
    """A plan of any motion, with the certificate that says that nothing was looked at."""
    certificate = certify(chain, None, None, parameters)
    plan = Plan.assembled(chain, parameters, 0, None, None, certificate)
    return replace(plan, motion=motion, max_error_rad=np.full(len(motion), np.nan))
