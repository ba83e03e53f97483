"""Steps of a fold: path → chain → record → playback → certificate → plan.

Each step is a function of values that returns a value. Files are the business of
``planner.pipeline.workspace``; a step writes only the timeline of its ``Watch``, if it has one.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path as FilePath
from typing import Any, Final

from planner.certificate.certificate import certify
from planner.certificate.table import table_certificate
from planner.chain.chain import Chain
from planner.explosion.strategies import on_lattice, run_strategy, strategies_for, windowed
from planner.motion.motion import Motion
from planner.motion.record import Record
from planner.motion.timeline import TimelineWriter
from planner.parameters.explosion import TableParameters
from planner.parameters.parameters import Parameters
from planner.pipeline.attempt import Attempt, Candidates, Trial
from planner.pipeline.attempt_pool import AttemptPool
from planner.pipeline.job import Job, Result, Search, Watch, is_smoothing
from planner.pipeline.preference import COMPUTING, Preference
from planner.pipeline.prepare import prepare
from planner.pipeline.request import PATH_SEED_MODULUS, FoldRequest
from planner.pipeline.search import Explode, PlayBack, Step, before_playback
from planner.pipeline.stage_results import Reading
from planner.plan.plan import Plan
from planner.plan.prepared import PreparedChains
from planner.playback.playback import Playback
from planner.playback.playback import play_back as simulate_playback
from planner.playback.table_playback import play_on_table
from planner.playback.unfolding import Unfolding, check_fits
from planner.progress import Progress
from planner.robot.smoothed import before_and_after, check_smoothable, smoothed_record

TABLE_MOTOR_RESERVE: Final = 1.5
"""Torque limit of the simulated motors on a table, as a multiple of the largest static torque in
the recorded motion. A larger value lets the chain accelerate more, so that it folds faster but
needs stronger motors. Chosen."""
MIN_SIZING_TORQUE_WP: Final = 1.0
"""Minimum static torque from which the torque limit of the motors on a table is computed, in w·p
(module weight × pitch). Smaller values leave motors of hardly loaded chains too little torque to
accelerate. Chosen."""
Sink = Callable[[Motion], None]


def read_plan(recorded: Plan) -> Reading:
    """Return the chain of a plan that is smoothed.

    Raises:
        InputError: When it cannot be smoothed.
    """
    check_smoothable(recorded)
    return Reading(candidates=Candidates((recorded.chain,), two_ended=False), kind="plan")


def read_shape(
    request: FoldRequest,
    data: bytes,
    *,
    start: Chain | None = None,
    prepared: PreparedChains | None = None,
) -> Reading:
    """Return the chains that fold into a shape, and how they were found.

    Args:
        request: FoldRequest of the fold.
        data: Bytes of the shape.
        start: Chain as it is folded at the beginning of a refold; None for other folds.
        prepared: Chains that a preview has found with the same request; None to search for them.

    Raises:
        InputError: When the input cannot be used.
    """
    if prepared is None:
        seed = request.seed % PATH_SEED_MODULUS
        prepared = prepare(data, request.filename, request.path_options(), seed=seed).prepared()
    chain, chains = prepared.chains[0], prepared.chains
    if start is not None:
        check_fits(start, chain.module.name, len(chain))
        # It is the same chain, whatever size the other shape was drawn in.
        chains = tuple(replace(c, pitch_m=start.pitch_m) for c in chains if len(c) == len(start))
        chain = chains[0]
    strategies_for(chain, request.parameters(), refolds=request.refold)  # or it is refused
    # A chain comes as it is wanted; what only shows cells may as well begin at their other end.
    given = prepared.kind == "chain" or request.start is not None or request.refold
    given = given or request.world == "table"  # whose path begins on it
    return Reading(
        candidates=Candidates(chains, two_ended=not given and on_lattice(chain)),
        kind=prepared.kind,
        method=prepared.method,
        notes=prepared.notes,
        knot=prepared.knot,
    )


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


def play_back(
    chain: Chain,
    record: Record | None,
    parameters: Parameters,
    watch: Watch,
    *,
    seed: int,
    finer: int = 1,
    unfolding: Unfolding | None = None,
) -> Playback | None:
    """Return the playback of a record; None when the chain was not straight after the explosion.

    Args:
        chain: Chain that is folded.
        record: Record of its explosion; None where nothing explodes.
        parameters: Parameters of the fold.
        watch: Channels to whoever follows.
        seed: Seed of the robots.
        finer: Factor of the number of frames.
        unfolding: Way of a refold to straight; None for other folds.
    """
    if record is not None and record.status != "straight":
        return None
    if record is not None and record.table is not None:
        return _play_on_table(chain, record, parameters.table, watch)
    # A refold's timeline goes from one shape to the other; a smoothed one only folds.
    whole = unfolding is not None or is_smoothing(record)
    start_s, frames = 0.0, 0
    if record is not None and not whole:
        start_s, frames = float(record.frames.time_s[-1]), len(record.frames)
    if watch.timeline is not None and whole:
        TimelineWriter.create(watch.timeline, chain)
    with _sink(watch.timeline, partial(TimelineWriter.reopen, frames=frames)) as sink:
        return simulate_playback(
            chain,
            record,
            parameters.playback,
            module_size=parameters.module_size,
            sink=sink,
            progress=watch.progress,
            cancelled=watch.cancelled,
            start_s=start_s,
            finer=finer,
            unfolding=unfolding,
            seed=seed,
        )


def _play_on_table(chain: Chain, record: Record, table: TableParameters, watch: Watch) -> Playback:
    """Fold the chain on the table, with motors slightly stronger than standing needs."""
    assert record.frames.is_windowed
    assert record.table is not None
    # Its frames are of all angles, the record's of windows: one timeline holds frames of one kind.
    exploded = record.frames.dense(chain)
    watch.progress(
        Progress(stage="play_back", fraction=0.0, message="computing the balance of each frame")
    )
    standing = table_certificate(
        chain,
        record.frames[::-1],
        friction=table.friction,
        base=table.base,
        on_table=True,
        height=chain.table_height,
    )
    asked = record.table.bound if standing.torque is None else standing.torque
    with _sink(watch.timeline, partial(TimelineWriter.create, chain=chain)) as sink:
        if sink is not None:
            sink(exploded)
        playback = play_on_table(
            chain,
            record.frames,
            torque_limit_wp=TABLE_MOTOR_RESERVE * max(asked, MIN_SIZING_TORQUE_WP),
            friction=table.friction,
            clamped=table.held,
            start_s=float(exploded.time_s[-1]),
            progress=watch.progress,
            cancelled=watch.cancelled,
        ).as_playback(chain.pitch_m)
        if sink is not None:
            sink(playback.frames)
    return playback


@contextmanager
def _sink(
    timeline: FilePath | None, opened: Callable[[FilePath], TimelineWriter]
) -> Generator[Sink | None]:
    """Yield what takes the frames of a playback; None where nobody follows."""
    if timeline is None:
        yield None
        return
    with opened(timeline) as writer:
        yield writer.append


def judge(result: Result, parameters: Parameters, watch: Watch, *, start: Chain | None) -> Result:
    """Return a result with its certificate, and the curves that belong to that."""
    playback, curves = result.playback, dict[str, Any]()
    peeled = playback is not None and playback.frames.is_windowed
    certificate = certify(
        result.chain,
        result.record,
        playback,
        parameters,
        start=start,
        progress=watch.progress,
        cancelled=watch.cancelled,
        sink=partial(curves.__setitem__, "clearances") if peeled else None,
        forces=partial(curves.__setitem__, "forces"),
    )
    return replace(result, certificate=certificate, **curves)


def advance(job: Job, search: Search, step: Step, watch: Watch, pool: AttemptPool) -> Search:
    """Return the search after one more step; earlier results stay as they are."""
    if isinstance(step, Explode):
        return _explode(job, search, step.trial, watch, pool)
    if isinstance(step, PlayBack):
        search = replace(search, history=before_playback(search.history, job.policy))
        result = search.current
        playback = play_back(
            result.chain,
            result.record,
            job.parameters(result.record),
            watch,
            seed=job.request.seed,
            finer=step.finer,
            unfolding=job.unfolding,
        )
        result = replace(result, playback=playback, certificate=None)
        return search.with_current(result, replace(search.history[search.latest], played=True))
    result = search.current
    result = judge(result, job.parameters(result.record), watch, start=job.start)
    assert result.certificate is not None
    outcome = search.history[search.latest].judged(result.certificate, result.playback)
    return search.with_current(result, outcome)


def _explode(job: Job, search: Search, trial: Trial, watch: Watch, pool: AttemptPool) -> Search:
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
        request: FoldRequest of the fold.
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


def with_joint_errors(plan: Plan, playback: Playback | None) -> Plan:
    """Return a plan with the joint errors of its playback, which its file leaves out."""
    if playback is None:
        return plan
    return replace(plan, motion=replace(plan.motion, errors_rad=playback.frames.errors_rad))
