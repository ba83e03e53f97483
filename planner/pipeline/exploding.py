"""Exploding: chain → record, by an explosion or by smoothing a plan."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from planner.chain.chain import Chain
from planner.explosion.strategies import run_strategy, windowed
from planner.motion.record import Record
from planner.motion.timeline import TimelineWriter
from planner.parameters.parameters import Parameters
from planner.pipeline.attempt import Attempt, Trial
from planner.pipeline.attempt_pool import AttemptPool
from planner.pipeline.job import Job, Result, Search, Watch
from planner.pipeline.preference import COMPUTING, Preference
from planner.pipeline.search import Explode, before_explosion, next_step, with_count
from planner.pipeline.workspace import Workspace
from planner.plan.plan import Plan
from planner.progress import Progress
from planner.robot.smoothed import smoothed_record


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Exploded:
    """Result of the stage ``explode``.

    Attributes:
        record: Record of the explosion that came farthest; None where nothing explodes.
        attempts: Number of attempts so far.
    """

    record: Record | None
    attempts: int

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        if self.record is None:
            return {"status": "none", "reason": "", "steps": 0, "frames": 0, "seconds": 0.0}
        return {**self.record.summary(), "attempts": self.attempts}


def explode_until_straight(workspace: Workspace, watch: Watch, pool: AttemptPool) -> Exploded:
    """Run the stage ``explode``: explosions, until one ends straight or nothing is left to try."""
    job = workspace.read_job()
    if job.request.smooth:
        job = replace(job, recorded=workspace.read_recorded())
    search = Search(history=before_explosion(workspace.read_history(), job.policy))
    if not search.history:  # what an earlier fold left here must not pass for a result of this one
        workspace.clear()
    workspace.drop_pictures()
    while isinstance(step := next_step(search.history, job.policy), Explode):
        number = len(search.history)
        begun = (*search.history, Attempt(trial=step.trial, status="begun"))
        place = workspace.begin(number, job.candidates.chain_of(step.trial))
        workspace.write_history(begun)
        if (smooths := step.trial.smooths) is not None:
            known = workspace.attempt_of(smooths).read_result()
            search = replace(search, results={**search.results, smooths: known})
        report = with_count(watch.progress, begun, job.policy)
        there = replace(watch, progress=report, timeline=place.timeline)
        search = with_explosion(job, search, step.trial, there, pool)
        place.write_explosion(search.results[number])
        workspace.write_history(search.history)
        workspace.keep_best_explosion()
    record = search.results[workspace.number or 0].record
    rest(pool, record, len(search.history), job.request.prefer)
    return Exploded(record=record, attempts=len(search.history))


def with_explosion(
    job: Job, search: Search, trial: Trial, watch: Watch, pool: AttemptPool
) -> Search:
    """Return the search after one more explosion or smoothing."""
    number, chain = len(search.history), job.candidates.chain_of(trial)
    parameters = job.parameters()
    record, recorded = None, None
    smooths = trial.smooths is not None or job.request.smooth
    if watch.timeline is not None and (smooths or parameters.explosion is None):
        TimelineWriter.create(watch.timeline, chain)  # an explosion begins its own
    if smooths:
        if trial.smooths is not None:
            recorded = search.results[trial.smooths].plan(job.request)
        source = recorded or job.recorded
        assert source is not None
        record = smooth(source, trial, parameters, watch)
    elif parameters.explosion is not None:
        pool.schedule(job.policy, search.history, trial)
        record = pool.collect(watch.timeline, watch.progress, watch.cancelled)
        if record is None:
            watch = replace(watch, progress=pool.with_speculation(watch.progress))
            record = explode(chain, trial, parameters, watch)
    outcome = Attempt.of_record(trial, chain, record, parameters)
    result = Result(chain=chain, record=record, recorded=recorded)
    return Search(history=(*search.history, outcome), results={**search.results, number: result})


def explode(chain: Chain, trial: Trial, parameters: Parameters, watch: Watch) -> Record:
    """Return the record of one explosion, straight or not."""
    writer = None
    if watch.timeline is not None:
        writer = TimelineWriter.create(watch.timeline, chain, windowed=windowed(trial.strategy))
    record = run_strategy(
        chain,
        trial.strategy,
        parameters,
        seed=trial.seed,
        gentle=trial.gentle,
        sink=None if writer is None else writer.append,
        progress=watch.progress,
        cancelled=watch.cancelled,
    )
    if writer is not None:
        writer.flush()
        if record.status != "straight":
            writer.close("failed")
    return record


def smooth(recorded: Plan, trial: Trial, parameters: Parameters, watch: Watch) -> Record:
    """Return the record of a smoothed plan; no frame of it is shown before it is played back."""

    def report(part: float) -> None:
        watch.progress(Progress(stage="explode", fraction=min(part, 0.99), message="smoothing"))

    report(0.0)
    return smoothed_record(
        recorded,
        trial.strategy,
        size=parameters.module_size,
        seed=trial.seed,
        told=report,
        cancelled=watch.cancelled,
    )


def rest(pool: AttemptPool, record: Record | None, attempts: int, prefer: Preference) -> None:
    """End what explodes beside, when the last explosion of a series makes it of little use.

    Args:
        pool: Explosions that are made beside.
        record: Record of the explosion that is played back next; None where nothing explodes.
        attempts: Number of attempts so far.
        prefer: Preference among verified plans.
    """
    wanted = attempts > 1 or prefer != COMPUTING  # what comes out at once is rarely refused
    if record is not None and (record.status != "straight" or not wanted):
        pool.end_running()
