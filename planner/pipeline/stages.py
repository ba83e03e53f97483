"""Stages of a fold, each restartable, over one directory.

A stage loads what the steps before it have saved, computes the steps that belong to it, and saves
their results first and the outcome last. The steps are functions of values in ``reading``,
``exploding``, ``playing_back``, ``certifying`` and ``exporting``. The service runs each stage in a
process of its own; the command line runs them one after the other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import Any, Final

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.pipeline import manifest
from foldback.planner.pipeline.attempt import Attempt
from foldback.planner.pipeline.attempt_pool import AttemptPool
from foldback.planner.pipeline.driver import Store, run_steps
from foldback.planner.pipeline.exporting import finish
from foldback.planner.pipeline.next_step import (
    Certify,
    Explode,
    PlayBack,
    Step,
    before_explosion,
    before_playback,
    next_step,
    with_choice,
)
from foldback.planner.pipeline.preference import COMPUTING
from foldback.planner.pipeline.reading import Reading, read_plan, read_shape
from foldback.planner.pipeline.search import FoldSpec, Search, Watch, is_smoothing, keeps_frames
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.progress import STAGES, Cancelled, Progress, Report, never, silent
from foldback.planner.reasons import Reason
from foldback.planner.reasons import ReasonCode as Code
from foldback.planner.storage.file_names import DESCRIBED, EXPORTED_FILES, PLAYBACK

NO_EXPLOSION: Final = {"status": "none", "reason": None, "steps": 0, "frames": 0, "seconds": 0.0}
"""Figures of the stage ``explode`` where nothing explodes."""
NOT_PLAYED: Final = {
    "status": "skipped",
    "reason": Reason.of(Code.NOT_STRAIGHT).as_dict(),
    "steps": 0,
    "seconds": 0.0,
    "rms_position_error": None,
    "max_angle_error_rad": None,
}
"""Figures of the stage ``play_back`` when the chain was not straight after the explosion."""


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
    watch = Watch(progress=progress, cancelled=cancelled)
    figures = _computed(stage, workspace, watch, pool)
    progress(Progress(stage=stage, fraction=1.0, message="done"))
    return figures


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


def _computed(stage: str, workspace: Workspace, watch: Watch, pool: AttemptPool) -> dict[str, Any]:
    match stage:
        case "read":
            return read_chains(workspace).as_dict()
        case "explode":
            return explode_until_straight(workspace, watch, pool)
        case "play_back":
            return play_back_latest(workspace, watch, pool)
        case "certify":
            return certify_latest(workspace, watch, pool)
        case "export":
            return export_best(workspace)
        case _:
            raise ValueError(f"got the stage {stage!r}, expected one of: {', '.join(STAGES)}.")


def read_chains(workspace: Workspace, shape: Path | Chain | None = None) -> Reading:
    """Run the stage ``read``: find the chains that may be folded, and write them.

    Args:
        workspace: Files of the fold.
        shape: The shape in its input; None to read that.
    """
    request = workspace.read_request()
    request.check()
    if request.smooth:
        result = read_plan(workspace.read_recorded())
    else:
        workspace.drop_recorded()  # of an earlier fold with a preference
        start = workspace.read_start(request)
        if shape is None:
            data = workspace.read_input()
            prepared = workspace.read_prepared(request, data)
            result = read_shape(request, data, start=start, prepared=prepared)
        else:
            result = read_shape(request, shape, start=start)
    workspace.clear()
    workspace.write_candidates(result.candidates)
    workspace.drop_prepared()
    return result


@dataclass(frozen=True, slots=True)
class InDirectory(Store):
    """Store of a fold in its directory: the results of a step are saved first, the outcome last.

    Attributes:
        workspace: Files of the fold.
    """

    workspace: Workspace

    def begin(
        self, fold_spec: FoldSpec, search: Search, step: Step, history: Sequence[Attempt]
    ) -> tuple[Search, FilePath | None]:
        """Remove the files that the step writes; load the plan that it smooths."""
        workspace = self.workspace
        if isinstance(step, Explode):
            place = workspace.begin(len(search.history), fold_spec.candidates.chain_of(step.spec))
            workspace.write_history(history)
            if (smooths := step.spec.smooths) is not None:
                smoothed = workspace.attempt_of(smooths).read_result()
                search = replace(search, results={**search.results, smooths: smoothed})
            return search, place.timeline
        place = workspace.attempt
        if isinstance(step, Certify):
            place.drop_curves()
            return search, None
        place.drop_playback()
        workspace.write_history(history)
        return search, place.timeline

    def save(self, search: Search, step: Step) -> None:
        """Write the results of a step."""
        workspace = self.workspace
        if isinstance(step, Explode):
            number = len(search.history) - 1
            if number in search.results:
                result, refold = search.results[number], workspace.read_request().refold
                frames = refold or keeps_frames(result.record)
                workspace.attempt_of(number).write_explosion(result, frames=frames)
            workspace.write_history(search.history)
            workspace.keep_explosions(search.results)
        elif isinstance(step, Certify):
            workspace.attempt.write_judgement(search.current)
            workspace.write_history(search.history)
        elif search.current.playback is not None:
            workspace.attempt.write_playback(search.current.playback)


def explode_until_straight(workspace: Workspace, watch: Watch, pool: AttemptPool) -> dict[str, Any]:
    """Run the stage ``explode``: explosions, until one ends straight or nothing is left to try.

    Returns:
        Figures of the explosion that came farthest, and the number of attempts so far.
    """
    fold_spec = workspace.read_fold_spec()
    if fold_spec.request.smooth:
        fold_spec = replace(fold_spec, recorded=workspace.read_recorded())
    search = Search(history=before_explosion(workspace.read_history(), fold_spec.policy))
    if not search.history:  # what an earlier fold left here must not pass for a result of this one
        workspace.clear()
    workspace.drop_derived()
    search = run_steps(fold_spec, search, InDirectory(workspace), watch, pool, only=Explode)
    record = search.current.record
    if record is None:
        return dict(NO_EXPLOSION)
    return {**record.summary(), "attempts": len(search.history)}


def play_back_latest(workspace: Workspace, watch: Watch, pool: AttemptPool) -> dict[str, Any]:
    """Run the stage ``play_back``: play the latest record back, if it ends straight."""
    fold_spec = workspace.read_fold_spec()
    fold_spec = replace(fold_spec, unfolding=workspace.read_unfolding(fold_spec.request))
    search = workspace.read_search(fold_spec)
    search = replace(search, history=before_playback(search.history, fold_spec.policy))
    search = run_steps(fold_spec, search, InDirectory(workspace), watch, pool, only=PlayBack)
    playback = search.current.playback
    return dict(NOT_PLAYED) if playback is None else playback.summary()


def certify_latest(workspace: Workspace, watch: Watch, pool: AttemptPool) -> dict[str, Any]:
    """Run the stage ``certify``: judge the latest playback, and say which stage follows.

    Returns:
        Certificate of the best attempt when nothing else is tried, else of the latest one; as
        ``again`` the stage that tries again, None when nothing else is tried.
    """
    fold_spec = workspace.read_fold_spec()
    search = workspace.read_search(fold_spec)
    played = replace(search.history[search.latest].unjudged(), played=True)
    search = search.with_current(search.current, played)
    search = run_steps(fold_spec, search, InDirectory(workspace), watch, pool, only=Certify)
    certificate = search.current.certificate
    assert certificate is not None
    following_stage = None
    if not watch.cancelled():
        step = next_step(search.history, fold_spec.policy)
        following_stage = step and ("explode" if isinstance(step, Explode) else "play_back")
        if step is None:
            workspace.keep_best(fold_spec.request.prefer)
            certificate = workspace.read_certificate() or certificate
    return {**certificate.as_dict(), "again": following_stage}


def export_best(workspace: Workspace) -> dict[str, Any]:
    """Run the stage ``export``: write the best plan, its model and the digests of all files."""
    request, history = workspace.read_request(), workspace.read_history()
    best = workspace.keep_best(request.prefer)
    if best is not None and request.prefer != COMPUTING:
        history = with_choice(history, best)
        workspace.write_history(history)
    workspace.publish(request.prefer)
    result, start = workspace.read_result(), workspace.read_start(request)
    recorded = workspace.read_recorded() if is_smoothing(result.record) else None
    plan = finish(
        request,
        result,
        history,
        candidates=workspace.read_candidates(),
        start=start,
        recorded=recorded,
    )
    workspace.drop_derived()
    before = [name for name in DESCRIBED if name not in (*EXPORTED_FILES, PLAYBACK)]
    with ThreadPoolExecutor(1) as beside:
        digests = beside.submit(manifest.digests_of, workspace.directory, before)
        workspace.write_plan(plan, result.playback)
    manifest.write_manifest(workspace.directory, digests.result())
    return plan.summary()
