"""Exploding: chain → record, by an explosion or by smoothing a plan."""

from __future__ import annotations

from dataclasses import replace

from foldback.planner.chain.chain import Chain
from foldback.planner.explosion.strategies import records_windows, run_strategy
from foldback.planner.motion.record import Record
from foldback.planner.motion.timeline import TimelineWriter
from foldback.planner.parameters.parameters import AUTO, Parameters
from foldback.planner.pipeline.attempt import Attempt, AttemptSpec
from foldback.planner.pipeline.attempt_pool import AttemptPool
from foldback.planner.pipeline.preference import CALM
from foldback.planner.pipeline.search import FoldSpec, Result, Search, Watch
from foldback.planner.plan.plan import Plan
from foldback.planner.progress import Progress


def with_explosion(
    fold_spec: FoldSpec, search: Search, spec: AttemptSpec, watch: Watch, pool: AttemptPool
) -> Search:
    """Return the search after one more explosion or smoothing."""
    number, chain = len(search.history), fold_spec.candidates.chain_of(spec)
    parameters = fold_spec.parameters()
    record, recorded = None, None
    smooths = spec.smooths is not None or fold_spec.request.smooth
    if watch.timeline is not None and (smooths or parameters.explosion is None):
        TimelineWriter.create(watch.timeline, chain)  # an explosion begins its own
    if smooths:
        if spec.smooths is not None:
            recorded = search.results[spec.smooths].plan(fold_spec.request)
        source = recorded or fold_spec.recorded
        assert source is not None
        calm = fold_spec.request.prefer == CALM
        record = smooth(source, spec, parameters, watch, calm=calm)
    elif parameters.explosion is not None:
        pool.schedule(fold_spec.policy, search.history, spec)
        record = pool.collect(watch.timeline, watch.progress, watch.cancelled)
        if record is None:
            watch = replace(watch, progress=pool.with_speculation(watch.progress))
            record = explode(chain, spec, parameters, watch)
    attempt = Attempt.of_record(spec, chain, record, parameters)
    result = Result(chain=chain, record=record, recorded=recorded)
    return Search(history=(*search.history, attempt), results={**search.results, number: result})


def explode(chain: Chain, spec: AttemptSpec, parameters: Parameters, watch: Watch) -> Record:
    """Return the record of one explosion, straight or not."""
    writer = None
    if watch.timeline is not None:
        writer = TimelineWriter.create(
            watch.timeline, chain, windowed=records_windows(spec.strategy)
        )
    record = run_strategy(
        chain,
        spec.strategy,
        parameters,
        seed=spec.seed,
        gentle=spec.gentle,
        roomy=spec.roomy,
        calm=parameters.strategy == AUTO and not spec.plain,
        sink=None if writer is None else writer.append,
        progress=watch.progress,
        cancelled=watch.cancelled,
    )
    if writer is not None:
        writer.flush()
        if record.status != "straight":
            writer.close("failed")
    return record


def smooth(
    recorded: Plan, spec: AttemptSpec, parameters: Parameters, watch: Watch, *, calm: bool
) -> Record:
    """Return the record of a smoothed plan; no frame of it is shown before it is played back."""
    from foldback.planner.smoothing.smoothed_plan import smoothed_record  # late: rarely needed

    def report(part: float) -> None:
        watch.progress(Progress(stage="explode", fraction=min(part, 0.99), message="smoothing"))

    report(0.0)
    return smoothed_record(
        recorded,
        spec.strategy,
        module_size=parameters.module_size,
        seed=spec.seed,
        calm=calm,
        report=report,
        cancelled=watch.cancelled,
    )
