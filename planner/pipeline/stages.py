"""Stages of a fold, each restartable, over one directory.

A stage loads what the steps before it have saved, computes the steps that belong to it, and saves
their results first and the outcome last. The service runs each stage in a process of its own; the
command line runs them one after the other.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path as FilePath
from typing import Any, Final

from planner.pipeline.attempt_pool import AttemptPool
from planner.pipeline.certifying import Judged, certify_latest
from planner.pipeline.exploding import Exploded, explode_until_straight
from planner.pipeline.exporting import Exported, export_best
from planner.pipeline.job import Watch
from planner.pipeline.playing_back import Played, play_back_latest
from planner.pipeline.preference import COMPUTING
from planner.pipeline.reading import Reading, read_chains
from planner.pipeline.retry_policy import RetryPolicy
from planner.pipeline.search import with_count
from planner.pipeline.workspace import Workspace
from planner.progress import STAGES, Cancelled, Progress, Report, never, silent

STAGES_OF_LAST_ATTEMPT: Final = ("play_back", "certify")
"""Stages of a fold that process the attempt that the stage ``explode`` made last; their progress
reports say which attempt of how many it is."""


def run_stage(
    stage: str,
    directory: FilePath,
    *,
    progress: Report = silent,
    cancelled: Cancelled = never,
    pool: AttemptPool | None = None,
) -> dict[str, Any]:
    """Run one stage of the fold in a directory, for a service.

    Args:
        stage: One of ``planner.progress.STAGES``; the earlier ones must have run.
        directory: Holds ``request.json`` and ``input``, and the files of the stages so far.
        progress: Called with the progress.
        cancelled: Asked periodically whether to stop.
        pool: Makes what may be tried next beside; it must outlast all stages of the fold. None for
            one explosion after the other.

    Returns:
        The stage's figures, as plain JSON values.

    Raises:
        InputError: From ``read``, when the input cannot be used.
    """
    workspace, pool = Workspace(directory), pool or AttemptPool(directory)
    workspace.drop_manifest()  # of what is written now
    if stage == "export":
        pool.end_running()  # what is written now is the end
    if stage in STAGES_OF_LAST_ATTEMPT:
        progress = _counting(workspace, progress)
    watch = Watch(progress=progress, cancelled=cancelled)
    found = _computed(stage, workspace, watch, pool)
    progress(Progress(stage=stage, fraction=1.0, message="done"))
    return found.as_dict()


def _counting(workspace: Workspace, progress: Report) -> Report:
    """Return a report that tells which of about how many plans the fold's last attempt is."""
    request = workspace.read_request()
    if request.prefer == COMPUTING:
        return progress
    policy = RetryPolicy.of(request, workspace.read_candidates())
    return with_count(progress, workspace.read_history(), policy)


def next_stage(stage: str, result: dict[str, Any]) -> str | None:
    """Return the stage after one that gave a result: an earlier one again, or None at the end."""
    if result.get("again"):
        return str(result["again"])
    place = STAGES.index(stage) + 1
    return STAGES[place] if place < len(STAGES) else None


def run_stages(
    directory: FilePath,
    *,
    first: str = STAGES[0],
    until: str | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
    workers: int = 1,
    around: Callable[[str], AbstractContextManager[Report]] | None = None,
) -> dict[str, Any]:
    """Run the stages, those again that a refused plan makes necessary; return the last figures.

    Args:
        directory: Same as for ``run_stage``.
        first: Stage to begin with; the earlier ones must have run.
        until: Stage that is not run any more; None to run all, up to the plan.
        progress, cancelled: Same as for ``run_stage``.
        workers: Explosions that are made at once at most. The plan is the same for any number.
        around: Returns, for the name of a stage, the context in which it runs; the context gives
            the function that receives its progress. None for ``progress`` alone.

    Raises:
        InputError: When the input cannot be used.
    """
    stage: str | None = first
    figures: dict[str, Any] = {}
    with AttemptPool(directory, workers) as pool:
        while stage is not None and stage != until:
            with around(stage) if around is not None else nullcontext(progress) as report:
                figures = run_stage(
                    stage, directory, progress=report, cancelled=cancelled, pool=pool
                )
            stage = next_stage(stage, figures)
    return figures


def _computed(
    stage: str, workspace: Workspace, watch: Watch, pool: AttemptPool
) -> Reading | Exploded | Played | Judged | Exported:
    match stage:
        case "read":
            return read_chains(workspace)
        case "explode":
            return explode_until_straight(workspace, watch, pool)
        case "play_back":
            return play_back_latest(workspace, watch)
        case "certify":
            return certify_latest(workspace, watch)
        case "export":
            return export_best(workspace)
        case _:
            raise ValueError(f"got the stage {stage!r}, expected one of: {', '.join(STAGES)}.")
