"""The stage that explodes a chain: attempt after attempt, until one ends straight."""

from __future__ import annotations

from pathlib import Path as FilePath
from shutil import rmtree
from typing import Any

from planner.explosion.strategies import strategies_for
from planner.motion.record import Record
from planner.motion.timeline import TimelineWriter
from planner.pipeline import attempts, refused
from planner.pipeline.attempts import Candidates
from planner.pipeline.best_record import BestRecord
from planner.pipeline.fold_directory import read_recorded, read_request, write_chain_folded
from planner.pipeline.parallel import Tries, make_try
from planner.pipeline.portfolio import MOST_SEEDS, Attempt, Choice, Try
from planner.pipeline.request import Request
from planner.progress import Cancelled, Progress, Report
from planner.robot import WAYS
from planner.robot.smoothed import smoothed_record
from planner.simulation.parameters import ExplosionParameters


def explode_stage(
    directory: FilePath, progress: Report, cancelled: Cancelled, tries: Tries
) -> dict[str, Any]:
    """Explodes the chain of a fold, or smooths its plan, until one attempt ends straight.

    Args and what it returns: as for ``planner.pipeline.stages.run_stage``.
    """
    request = read_request(directory)
    candidates = Candidates.load(directory)
    choice = choice_of(request, candidates)
    tried = attempts.before_explosion(directory, choice)
    if tried:
        refused.put_aside(directory)
    else:
        refused.drop(directory)
    # What an earlier fold left in this directory must not pass for a result of this one.
    for name in ("record.npz", "playback.npz", "picture.png"):
        (directory / name).unlink(missing_ok=True)
    rmtree(directory / "figures.zarr", ignore_errors=True)
    if request.parameters().explosion is None:
        TimelineWriter.create(directory / "timeline.zarr", candidates.chains[0])
        attempts.save(directory, [])
        return {"status": "none", "reason": "", "steps": 0, "frames": 0, "seconds": 0.0}
    best = BestRecord(directory)
    while (todo := choice.after(tried)) is not None:
        chain = candidates.chain_of(todo)
        write_chain_folded(directory, chain)
        attempts.save(directory, [*tried, Attempt(todo=todo, status="begun")])
        if request.smooth:
            record = _smoothed(directory, request, todo, progress, cancelled)
            attempt = attempts.made(todo, chain, record)
        else:
            tries.come_to(choice, tried, todo)
            record, attempt = tries.take(progress, cancelled) or make_try(
                directory, request.parameters(), chain, todo, tries.watched(progress), cancelled
            )
        tried.append(attempt)
        best.look_at(chain, record)
        if record.status in ("straight", "cancelled"):
            break
    record = best.keep()
    if record.status != "straight" or len(tried) == 1:
        tries.rest()  # what comes out at once is rarely refused
    attempts.save(directory, tried)
    record.save(directory / "record.npz")
    return {**record.summary(), "attempts": len(tried)}


def choice_of(request: Request, candidates: Candidates) -> Choice:
    """What may be tried of a fold."""
    if request.smooth:
        return Choice(strategies=(WAYS,), seed=request.seed, seeds=1)
    parameters = request.parameters()
    ours = isinstance(parameters.explosion, ExplosionParameters)
    return Choice(
        strategies=tuple(
            strategies_for(chain, parameters, refolds=request.refold) for chain in candidates.chains
        ),
        seed=request.seed,
        two_ended=candidates.two_ended,
        forces=ours,
        seeds=MOST_SEEDS if ours else 1,  # as published there is nothing that a seed changes
    )


def _smoothed(
    directory: FilePath, request: Request, todo: Try, progress: Report, cancelled: Cancelled
) -> Record:
    """One smoothing, of which there is nothing to see before it is played back."""
    recorded = read_recorded(directory)
    TimelineWriter.create(directory / "timeline.zarr", recorded.chain)

    def told(part: float) -> None:
        progress(Progress(stage="explode", fraction=min(part, 0.99), message="smoothing"))

    told(0.0)
    return smoothed_record(
        recorded,
        todo.strategy,
        size=request.parameters().module_size,
        seed=todo.seed,
        told=told,
        cancelled=cancelled,
    )
