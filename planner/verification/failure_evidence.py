"""Failure evidence of an explosion: a check of it from the chain and its record alone.

No code is shared with the one that finds the reasons (``planner.explosion.diagnosis`` and all that
it uses): knots, overlaps and limits are computed by other code.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.errors import UNREADABLE
from foldback.planner.explosion.failure_evidence import Diagnosis, evidence_from
from foldback.planner.motion.failure_schemas import (
    BudgetFigures,
    EvidenceFigures,
    SpentKind,
    StuckFigures,
)
from foldback.planner.motion.record import Record
from foldback.planner.parameters.explosion import PeelingParameters
from foldback.planner.plan.value_differences import Differences
from foldback.planner.verification.block_evidence import blocks_differ, quarter_turns_differ
from foldback.planner.verification.knot_evidence import knot_differs

MAX_STRAIGHT_HINGE_RAD: Final = 0.1
"""Maximum bend, in rad, of a hinge that counts as straight in the report of a failed explosion; it
must equal the value with which the report was made."""
STATUSES_BY_LIMIT: Final = {
    "steps": ("timeout",),
    "snapshots": ("timeout",),
    "pushes": ("stalled", "diverged"),
    "retries": ("diverged",),
    "motion": ("stalled",),
    "refusals": ("stalled",),
    "turns": ("stalled",),
    "turn_steps": ("stalled",),
}
"""Final statuses of an explosion that fit each kind of limit that it may have used up (simulation
steps, pushes, retries); a report with another combination is refused."""
REASON_KINDS: Final = {
    "knot": "a knot",
    "blocks": "modules that block each other",
    "quarter_turns": "modules that block each quarter turn",
    "budget": "a budget",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ReasonCheck:
    """Result of the check of a reason.

    Attributes:
        kind: One of ``REASON_KINDS``.
        diagnosis: The reason.
        differences: Contradictions, in plain English; empty if the reason is confirmed.
    """

    kind: str
    diagnosis: Diagnosis
    differences: tuple[str, ...]

    @property
    def confirmed(self) -> bool:
        """True if the reason is confirmed."""
        return not self.differences

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        return {
            "confirmed": self.confirmed,
            "kind": self.kind,
            "words": self.diagnosis.text(),
            "differences": list(self.differences),
        }


def check_reason(
    chain: Chain, record: Record, stuck: StuckFigures, parameters: Mapping[str, Any]
) -> ReasonCheck | None:
    """Check the reason of an explosion that did not end straight.

    Args:
        chain: The chain.
        record: Record of the explosion.
        stuck: The diagnosis, as plain JSON values.
        parameters: Parameters of the fold, as plain JSON values, as in a plan.

    Returns:
        Result of the check; None if the diagnosis has no evidence.
    """
    stated = stuck["evidence"]
    if stated is None:
        return None
    diagnosis = Diagnosis.from_dict({**stuck, "evidence": None})
    with suppress(ValueError):  # the differences say so
        diagnosis = Diagnosis.from_dict(stuck)
    try:
        if stated["kind"] in REASON_KINDS:
            evidence_from(stated)  # checks the types of its values
        differences = tuple(_differences(chain, record, stated, parameters))
    except UNREADABLE as error:
        differences = (f"the evidence cannot be checked ({type(error).__name__}: {error})",)
    return ReasonCheck(kind=str(stated.get("kind")), diagnosis=diagnosis, differences=differences)


def _differences(
    chain: Chain, record: Record, stated: EvidenceFigures, parameters: Mapping[str, Any]
) -> Differences:
    last = record.frames[-1:].dense(chain)
    angles = last.joint_angles_rad[0]
    if record.status not in ("stalled", "timeout", "diverged"):
        yield (
            f"status: got {record.status}, expected stalled, timeout or diverged, because the plan "
            "contains evidence of a failure"
        )
    elif stated["kind"] == "knot":
        yield from knot_differs(last.poses(chain).positions[0], stated)
    elif stated["kind"] == "blocks":
        peels = record.strategy == "peel"
        if stated["first_hinge"] and not peels:
            yield (
                f"first_hinge: got {stated['first_hinge']}, expected 0, because the strategy is "
                "not peel"
            )
        size = float(parameters["module_size"])
        if _limits_of(record) != "table":  # on a table, this size is what is kept clear
            limits: dict[str, Any] = parameters[_limits_of(record)] or {}
            size = max(size, float(limits.get("verify_size", 0.0)))
        yield from blocks_differ(chain, angles, stated, size)
    elif stated["kind"] == "quarter_turns":
        yield from quarter_turns_differ(chain, angles, stated, float(parameters["module_size"]))
    elif stated["kind"] == "budget":
        yield from _spent_differs(chain, record, stated, parameters)
        yield from _bends_differ(angles, stated)
    else:
        yield f"kind: got {stated['kind']!r}, expected one of {', '.join(REASON_KINDS)}"


def _limits_of(record: Record) -> str:
    """Return the name of the parameters with the limits of an explosion."""
    if record.strategy != "peel":
        return "explosion"
    return "peeling" if record.table is None else "table"


def _spent_differs(
    chain: Chain, record: Record, stated: BudgetFigures, parameters: Mapping[str, Any]
) -> Differences:
    """Yield the differences of a limit from record and parameters, or that it was not used up."""
    spent, allowed, used = stated["spent"], stated["allowed"], stated["used"]
    if record.status not in STATUSES_BY_LIMIT[spent]:
        yield f"spent: got {spent}, which does not fit the status {record.status}"
    if record.spent is None:
        yield f"spent: got {spent}, but the record states no limit that was used up"
        return
    recorded = (record.spent.kind, record.spent.allowed, record.spent.used)
    if (spent, allowed, used) != recorded:
        yield (
            f"spent: got {spent} (allowed {allowed}, used {used}), expected {recorded[0]} "
            f"(allowed {recorded[1]}, used {recorded[2]}), as in the record"
        )
    counted = _counted(record, spent)
    if used != counted:
        yield f"used: got {used} {spent}, expected {counted}, as in the record"
    # An error ends a run when the last push is used up, a stall when one more is needed.
    one_more = spent in ("snapshots", "refusals", "turn_steps") or (
        spent == "pushes" and record.status == "stalled"
    )
    if spent != "motion" and used < allowed + one_more:
        yield f"used: got {used} of {allowed} {spent}, expected at least the limit"
    limit = _limit(chain, record, spent, parameters)
    if allowed != (allowed if limit is None else limit):
        yield f"allowed: got {allowed} {spent}, expected {limit}, as in the parameters"
    if spent == "refusals":
        max_torque = float(parameters["table"]["table_torque"])
        if record.table is None or record.table.bound < max_torque:
            bound = "none" if record.table is None else f"{record.table.bound:g} w·p"
            yield (
                "spent: got refusals, expected another limit, because refusals end a run only at "
                f"the torque limit {max_torque:g} w·p; the torque limit in the record is {bound}"
            )


def _counted(record: Record, spent: SpentKind) -> int:
    """Return the recorded count of what a limit counts."""
    if spent == "refusals":
        return 0 if record.spent is None else record.spent.used
    return {
        "steps": record.steps,
        "motion": record.steps,
        "turns": record.steps,
        "turn_steps": record.steps,
        "pushes": record.pushes,
        "retries": record.retries,
        "snapshots": 0 if record.snapshots_rad is None else len(record.snapshots_rad),
    }[spent]


def _limit(
    chain: Chain, record: Record, spent: SpentKind, parameters: Mapping[str, Any]
) -> int | None:
    """Return the limit that the parameters set; None for one that they do not set."""
    if spent in ("turns", "turn_steps"):
        return None
    name = _limits_of(record)
    limits = parameters[name]
    if spent in ("steps", "motion"):
        if name == "explosion":
            return int(limits["max_steps"])
        per_module = int(limits["max_steps_per_module"])
        return PeelingParameters(max_steps_per_module=per_module).most_steps(len(chain))
    if name != "table":
        return None
    if spent == "pushes" and record.status == "stalled":
        return int(limits["most_pushes"])
    return int(limits["refusals"]) if spent == "refusals" else None


def _bends_differ(angles: Array, stated: BudgetFigures) -> Differences:
    """Yield the differences of the reported bends from those of the last frame."""
    bent = int((np.abs(angles) > MAX_STRAIGHT_HINGE_RAD).sum())
    if stated["bent_hinges"] != bent:
        yield f"bent_hinges: got {stated['bent_hinges']}, expected {bent}"
    largest = float(np.abs(angles).max(initial=0.0))
    if not abs(stated["largest_bend_rad"] - largest) <= 1e-9:  # rounding
        yield f"largest_bend_rad: got {stated['largest_bend_rad']:.6g}, expected {largest:.6g}"
