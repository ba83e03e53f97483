"""Reasons: whether what a refusal rests on holds, worked out from the chain and its record alone.

Nothing here is shared with what makes the reasons (``planner.explosion.diagnosis`` and all that it
asks): knots, overlaps and limits are found by other code.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.errors import UNREADABLE
from planner.motion.record import Record
from planner.motion.stuck_figures import BudgetFigures, EvidenceFigures, StuckFigures
from planner.parameters.explosion import PeelingParameters
from planner.plan.differences import Differences
from planner.verification.block_reason import blocks_differ
from planner.verification.knot_reason import knot_differs

Array = NDArray[np.float64]
BENT_RAD: Final = 0.1
"""Bend above which a hinge counts as still bent."""
BEND_WITHIN_RAD: Final = 1e-9
"""Radians by which the largest bend may be told otherwise."""
STATUSES: Final = {
    "steps": ("timeout",),
    "snapshots": ("timeout",),
    "pushes": ("stalled", "diverged"),
    "retries": ("diverged",),
    "motion": ("stalled",),
}
"""How an explosion ends that has used up a thing."""
KINDS: Final = {"knot": "a knot", "blocks": "modules that block each other", "budget": "a budget"}


@dataclass(frozen=True, slots=True, kw_only=True)
class ReasonCheck:
    """What a second look says of a reason.

    Attributes:
        kind: ``knot``, ``blocks`` or ``budget``.
        words: The reason, in plain words.
        differences: What speaks against it, in plain words; empty when it is confirmed.
    """

    kind: str
    words: str
    differences: tuple[str, ...]

    @property
    def confirmed(self) -> bool:
        """Whether the reason holds."""
        return not self.differences

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        values = asdict(self) | {"differences": list(self.differences)}
        return {"confirmed": self.confirmed, **values}


def check_reason(
    chain: Chain, record: Record, stuck: StuckFigures, parameters: Mapping[str, Any]
) -> ReasonCheck | None:
    """Whether the reason holds that is told of an explosion that did not end straight.

    Args:
        chain: The chain.
        record: Of the explosion.
        stuck: The diagnosis, as plain JSON values.
        parameters: Of the fold, as plain JSON values, as a plan has them.

    Returns:
        What came of it; None where the diagnosis gives no evidence, as earlier versions did not.
    """
    told = stuck.get("evidence")
    if told is None:
        return None
    try:
        differences = tuple(_differences(chain, record, told, parameters))
    except UNREADABLE as error:
        differences = (f"it cannot be computed ({type(error).__name__}: {error})",)
    return ReasonCheck(kind=str(told.get("kind")), words=stuck["words"], differences=differences)


def _differences(
    chain: Chain, record: Record, told: EvidenceFigures, parameters: Mapping[str, Any]
) -> Differences:
    last = record.frames[-1:].dense(chain)
    angles = last.joint_angles_rad[0]
    if record.status not in ("stalled", "timeout", "diverged"):
        yield f"status: got {record.status}, which needs no reason"
    elif told["kind"] == "knot":
        poses = chain.poses(angles, last.root_position[0], last.root_wxyz[0])
        yield from knot_differs(poses.positions, told)
    elif told["kind"] == "blocks":
        peels = record.strategy == "peel"
        if told["first_hinge"] and not peels:
            yield f"first_hinge: got {told['first_hinge']}, expected 0 without peeling"
        how: dict[str, Any] = parameters["peeling" if peels else "explosion"] or {}
        size = max(float(parameters["module_size"]), float(how.get("verify_size", 0.0)))
        yield from blocks_differ(chain, angles, told, size)
    elif told["kind"] == "budget":
        yield from _budget_differs(chain, record, angles, told, parameters)
    else:
        yield f"kind: got {told['kind']!r}, expected one of {', '.join(KINDS)}"


def _budget_differs(
    chain: Chain,
    record: Record,
    angles: Array,
    told: BudgetFigures,
    parameters: Mapping[str, Any],
) -> Differences:
    """Where a budget is not what the parameters allow, or was not used up."""
    spent, allowed, used = told["spent"], told["allowed"], told["used"]
    if record.status not in STATUSES[spent]:
        yield f"spent: got {spent}, which does not fit the status {record.status}"
    counted = {
        "steps": record.steps,
        "motion": record.steps,
        "pushes": record.pushes,
        "retries": record.retries,
        "snapshots": 0 if record.snapshots_rad is None else len(record.snapshots_rad),
    }[spent]
    if used != counted:
        yield f"used: got {used} {spent}, expected {counted}, as in the record"
    if spent != "motion" and used < allowed + (spent in ("pushes", "snapshots")):
        yield f"used: got {used} of {allowed} {spent}, expected at least the limit"
    if spent in ("steps", "motion"):
        if record.strategy == "peel":
            per_module = int(parameters["peeling"]["max_steps_per_module"])
            limit = PeelingParameters(max_steps_per_module=per_module).most_steps(len(chain))
        else:
            limit = parameters["explosion"]["max_steps"]
        if allowed != limit:
            yield f"allowed: got {allowed} steps, expected {limit}, as in the parameters"
    bent = int((np.abs(angles) > BENT_RAD).sum())
    if told["bent_hinges"] != bent:
        yield f"bent_hinges: got {told['bent_hinges']}, expected {bent}"
    largest = float(np.abs(angles).max(initial=0.0))
    if not abs(told["largest_bend_rad"] - largest) <= BEND_WITHIN_RAD:
        yield f"largest_bend_rad: got {told['largest_bend_rad']:.6g}, expected {largest:.6g}"
