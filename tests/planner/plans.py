"""Plans that somebody has changed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from planner.frames import Frames
from planner.plan import Plan


def changed(plan: Plan, **values: Any) -> Plan:
    """The plan with other values; columns of its frames may be among them."""
    columns = {name: values.pop(name) for name in list(values) if name in FRAME_COLUMNS}
    if columns:
        values["motion"] = replace(plan.whole(), **columns)
    return replace(plan, **values)


FRAME_COLUMNS = frozenset(Frames.__dataclass_fields__)
