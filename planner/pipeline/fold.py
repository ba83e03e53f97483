"""Fold: everything from a shape to a verified plan, in one call.

Without a directory, everything is computed in memory and no file is written.
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.parameters.parameters import AUTO, FLOATING, World
from foldback.planner.pipeline.attempt import Candidates
from foldback.planner.pipeline.attempt_pool import AttemptPool
from foldback.planner.pipeline.driver import Store, run_steps
from foldback.planner.pipeline.exporting import finish
from foldback.planner.pipeline.fold_layout import replacing_fold
from foldback.planner.pipeline.next_step import with_choice
from foldback.planner.pipeline.preference import COMPUTING, Preference
from foldback.planner.pipeline.reading import read_plan, read_shape
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.retry_policy import RetryPolicy
from foldback.planner.pipeline.search import FoldSpec, Search, Watch
from foldback.planner.pipeline.stages import read_chains, run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.shape_writers import write_chain, write_path
from foldback.planner.progress import STAGES, Cancelled, Report, naming, never, silent


def fold(
    shape: Path | Chain | bytes | str,
    *,
    preset: str = "default",
    seed: int = 0,
    module_size: float | None = None,
    settings: str = "",
    strategy: str = AUTO,
    at_once: int | None = None,
    prefer: Preference = COMPUTING,
    joint_error: str | None = None,
    modules: int | None = None,
    threshold: int | None = None,
    inside_out: bool = False,
    thickness: int = 1,
    world: World = FLOATING,
    directory: str | FilePath | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
    workers: int = 1,
) -> Plan:
    """Explode a shape's chain, play the record back and verify the result.

    Args:
        shape: A path through cells, a chain with its folded configuration, the bytes of a file
            with any shape, or the text of one, such as ``word:Anna``.
        preset: ``default``, ``paper`` or ``direct``.
        seed: Seed of all randomness.
        module_size: Size at which the plan is verified; None for the preset's.
        settings: Other numbers for ``paper`` or ``direct``, as ``damping=0.05,radial_gain=0.2``:
            see ``planner.parameters.settings_text``.
        strategy: Explosion strategy: ``auto``, or one of ``planner.explosion.strategies``.
        at_once: Maximum number of hinges that turn at once, for the strategy ``turns``; None for no
            limit.
        prefer: Preference among several verified plans; ``computing`` takes the first one.
        joint_error: Error of each hinge, such as ``0.3deg``, for which the largest possible module
            size is found, see ``Certificate.joint_errors``; None for an estimate.
        modules: Approximate number of modules of a mesh or picture; None for the default.
        threshold: Brightness, 1 to 99 percent, that divides a picture into figure and background;
            None for the one that divides it best.
        inside_out: Fold the background of a picture, not its figure.
        thickness: Thickness of a word or picture, in cells.
        world: ``floating``, or on a ``table`` under gravity.
        directory: Directory that gets the plan, the timeline and the model, when all are written;
            they replace those of an earlier fold. None to write no file.
        progress: Called with the progress, and with the temporary place of the growing timeline
            if there is a ``directory``: ``Progress.directory``.
        cancelled: Asked periodically whether to stop; the plan then is not verified.
        workers: Explosions that are made at once at most, when one sticks; the plan is the same.

    Returns:
        The plan, verified or not: see ``Plan.certificate``.

    Raises:
        InputError: A shape without a path; an unknown preset; a seed, number or setting out of
            range; or the directory cannot be used, see
            ``planner.pipeline.fold_layout.replacing_fold``.
    """
    if isinstance(shape, str):
        shape = shape.encode()
    request = FoldRequest(
        filename=None if isinstance(shape, bytes) else shape.name,
        preset=preset,
        seed=seed,
        module_size=module_size,
        settings=settings,
        strategy=strategy,
        at_once=at_once,
        prefer=prefer,
        joint_error=joint_error,
        modules=modules,
        threshold=threshold,
        inside_out=inside_out,
        thickness=thickness,
        world=world,
    )
    watch = Watch(progress=progress, cancelled=cancelled)
    return _plan_of(request, shape, directory, watch, workers=workers)


def refold(
    start: Plan,
    shape: Path | Chain,
    *,
    preset: str = "default",
    seed: int = 0,
    module_size: float | None = None,
    settings: str = "",
    strategy: str = AUTO,
    at_once: int | None = None,
    directory: str | FilePath | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
) -> Plan:
    """Unfold the chain of a plan and fold it into another shape: the paper's reconfiguration.

    Args:
        start: Plan of the shape that the chain starts as; of a refold, the shape that it ends as.
        shape: A path through as many cells as the chain has modules, or a chain like it.
        preset, seed, module_size, settings, strategy, at_once, directory, progress, cancelled: See
            ``fold``; they say how the other shape is folded.

    Returns:
        One plan from the one shape over straight to the other, verified or not.

    Raises:
        InputError: ``refold-differs`` when the modules or their number do, ``refold-not-folded``
            when ``start`` does not lead from straight to folded, or as ``foldback.fold``.
    """
    request = FoldRequest(
        filename=shape.name,
        preset=preset,
        seed=seed,
        module_size=module_size,
        settings=settings,
        strategy=strategy,
        at_once=at_once,
        refold=True,
    )
    watch = Watch(progress=progress, cancelled=cancelled)
    return _plan_of(request, shape, directory, watch, start=start)


def smooth_plan(
    plan: Plan,
    *,
    seed: int = 0,
    module_size: float | None = None,
    directory: str | FilePath | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
) -> Plan:
    """Smooth the motion of a plan: shortcuts, means and a new time scaling, certified anew.

    Args:
        plan: A verified plan that begins straight.
        seed, directory, progress, cancelled: See ``fold``.
        module_size: Size at which the result is verified; None for that of the plan.

    Returns:
        The smoothed plan, verified or not; ``Plan.smoothing`` says what has changed.

    Raises:
        InputError: See ``planner.smoothing.smoothed_plan.check_smoothable``; or a seed or size out
            of range.
    """
    request = FoldRequest.smoothing(plan, seed=seed, module_size=module_size)
    watch = Watch(progress=progress, cancelled=cancelled)
    return _plan_of(request, plan.chain, directory, watch, recorded=plan)


def _plan_of(
    request: FoldRequest,
    shape: Path | Chain | bytes,
    directory: str | FilePath | None,
    watch: Watch,
    *,
    start: Plan | None = None,
    recorded: Plan | None = None,
    workers: int = 1,
) -> Plan:
    """Return the plan of a request, computed in memory or by the stages in a directory.

    Args:
        request: Request of the fold.
        shape: Shape that the chain folds into.
        directory: Directory of the fold; None for memory.
        watch: Channels to the observer.
        start: Plan that a refold begins with; None for other folds.
        recorded: Plan that is smoothed; None for other folds.
        workers: Explosions that are made at once at most.
    """
    request.check()
    if directory is not None:
        with replacing_fold(FilePath(directory)) as place:
            workspace = Workspace(place)
            workspace.write_request(request, _file_of(shape), start=start, recorded=recorded)
            read_chains(workspace, None if isinstance(shape, bytes) else shape)
            run_stages(
                place,
                first=STAGES[1],
                progress=naming(place, watch.progress),
                cancelled=watch.cancelled,
                workers=workers,
            )
            return workspace.read_plan()
    begins = None if start is None else start.chain
    reading = read_shape(request, shape, start=begins) if recorded is None else read_plan(recorded)
    fold_spec = FoldSpec(
        request=request,
        candidates=reading.candidates,
        policy=RetryPolicy.of(request, reading.candidates),
        start=begins,
        unfolding=None if start is None else start.unfolding(),
        recorded=recorded,
    )
    with _pool(request, reading.candidates, workers) as pool:
        search = run_steps(fold_spec, Search(), Store(), watch, pool)
    return _best_plan(fold_spec, search)


def _file_of(shape: Path | Chain | bytes) -> bytes:
    """Return the bytes of a file with a shape."""
    if isinstance(shape, bytes):
        return shape
    return write_path(shape) if isinstance(shape, Path) else write_chain(shape)


def _best_plan(fold_spec: FoldSpec, search: Search) -> Plan:
    """Return the plan of the best attempt, as it is read from a file."""
    prefer, history = fold_spec.request.prefer, search.history
    best = max(search.results, key=lambda number: search.rank(number, prefer))
    if prefer != COMPUTING:
        history = with_choice(history, best)
    result = search.results[best]
    plan = finish(
        fold_spec.request,
        result,
        history,
        candidates=fold_spec.candidates,
        start=fold_spec.start,
        recorded=result.recorded or fold_spec.recorded,
    )
    return plan.as_stored().with_joint_errors_of(result.playback)


@contextmanager
def _pool(request: FoldRequest, candidates: Candidates, workers: int) -> Generator[AttemptPool]:
    """Yield what makes explosions beside; it has a directory of its own if it has processes."""
    if workers == 1:
        yield AttemptPool(None)
        return
    with TemporaryDirectory(prefix="foldback-tries-") as place:
        workspace = Workspace(FilePath(place))
        workspace.write_request(request, b"")
        workspace.write_candidates(candidates)
        with AttemptPool(workspace.directory, workers) as pool:
            yield pool
