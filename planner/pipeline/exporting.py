"""Exporting: the best attempt → plan."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

from planner.chain.chain import Chain
from planner.file_names import DESCRIBED, EXPORTED_FILES, PLAN_TEXT
from planner.pipeline import manifest
from planner.pipeline.attempt import Attempt
from planner.pipeline.job import Result, is_smoothing
from planner.pipeline.preference import COMPUTING
from planner.pipeline.request import FoldRequest
from planner.pipeline.search import with_choice
from planner.pipeline.workspace import Workspace
from planner.plan.plan import Plan
from planner.robot.smoothed import before_and_after


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Exported:
    """Result of the stage ``export``.

    Attributes:
        plan: Plan of the fold.
    """

    plan: Plan

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        return self.plan.summary()


def export_best(workspace: Workspace) -> Exported:
    """Run the stage ``export``: write the best plan, its figures, moments and digests."""
    request, history = workspace.read_request(), workspace.read_history()
    best = workspace.keep_best(request.prefer)
    if best is not None and request.prefer != COMPUTING:
        history = with_choice(history, best)
        workspace.write_history(history)
    workspace.publish(request.prefer)
    result, start = workspace.read_result(), workspace.read_start(request)
    recorded = workspace.read_recorded() if is_smoothing(result.record) else None
    plan = finish(request, result, history, start=start, recorded=recorded)
    before = [name for name in DESCRIBED if name not in EXPORTED_FILES]
    with ThreadPoolExecutor(2) as beside:
        figures = beside.submit(_write_figures, workspace)
        digests = beside.submit(manifest.digests_of, workspace.directory, before)
        texts = workspace.write_plan(plan)
        figures.result()
    # Of a thousand numbers that were just written as text, it is not asked for once more.
    written = {PLAN_TEXT: manifest.digests_of_texts(texts)}
    manifest.write_manifest(workspace.directory, digests.result() | written)
    return Exported(plan=plan)


def _write_figures(workspace: Workspace) -> None:
    workspace.write_figures()
    workspace.write_moments()


def finish(
    request: FoldRequest,
    result: Result,
    history: Sequence[Attempt],
    *,
    start: Chain | None,
    recorded: Plan | None,
) -> Plan:
    """Return the plan of a fold that is over, with all that was tried.

    Args:
        request: Request of the fold.
        result: Result of the best attempt.
        history: All attempts.
        start: Chain as it is folded at the beginning of a refold; None for other folds.
        recorded: Plan that was smoothed; None for an explosion.
    """
    plan = replace(
        result.plan(request),
        attempts=tuple(each.as_dict() for each in history if each.status != "none"),
        start=start,
    )
    if not is_smoothing(result.record):
        return plan
    assert recorded is not None
    return replace(plan, smoothing=before_and_after(recorded, plan))
