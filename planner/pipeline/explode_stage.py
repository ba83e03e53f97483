"""The stage that explodes a chain: attempt after attempt, until one ends straight."""

from __future__ import annotations

from pathlib import Path as FilePath
from shutil import rmtree
from typing import Any, Final

from planner.chain.chain import Chain
from planner.explosion.strategies import others_for, strategies_for
from planner.motion.record import Record
from planner.motion.timeline import TimelineWriter
from planner.parameters.explosion import ExplosionParameters
from planner.pipeline import attempt_folders, attempts
from planner.pipeline.attempt import Attempt, Try
from planner.pipeline.attempts import Candidates
from planner.pipeline.fold_directory import (
    read_attempt,
    read_recorded,
    read_request,
    write_chain_folded,
)
from planner.pipeline.improvements import Improvements
from planner.pipeline.parallel import Tries, make_try
from planner.pipeline.portfolio import MOST_SEEDS, Portfolio
from planner.pipeline.preference import COMPUTING
from planner.pipeline.request import Request
from planner.progress import Cancelled, Progress, Report
from planner.robot import MAX_SMOOTHED_ANGLES, RECORDED_PLAN, SMOOTHING_WAYS
from planner.robot.smoothed import smoothed_record

DENSER: Final = 4
"""Factor of the frames that a plan may get when it is smoothed, peeled ones most."""


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
    # What an earlier fold left in this directory must not pass for a result of this one.
    if not tried:
        attempt_folders.clear(directory)
    (directory / "picture.png").unlink(missing_ok=True)
    rmtree(directory / "figures.zarr", ignore_errors=True)
    if request.parameters().explosion is None:
        _begun(directory, 0, candidates.chains[0])
        attempts.save(directory, [])
        return {"status": "none", "reason": "", "steps": 0, "frames": 0, "seconds": 0.0}
    made: dict[int, Record] = {}
    while (todo := choice.after(tried)) is not None:
        number, chain = len(tried), candidates.chain_of(todo)
        place = _begun(directory, number, chain)
        begun = [*tried, Attempt(todo=todo, status="begun")]
        attempts.save(directory, begun)
        report = attempts.with_count(progress, begun, choice)
        if request.smooth or todo.smooths is not None:
            if todo.smooths is not None:
                attempted = read_attempt(attempt_folders.place_of(directory, todo.smooths), request)
                attempted.save_npz(place / RECORDED_PLAN)
            record = _smoothed(directory, request, todo, report, cancelled)
            attempt = attempts.made(todo, chain, record, request.parameters())
        else:
            tries.come_to(choice, tried, todo)
            record, attempt = tries.take(place, report, cancelled) or make_try(
                place, request.parameters(), chain, todo, tries.watched(report), cancelled
            )
        record.save(place / "record.npz")
        made[number] = record
        tried.append(attempt)
        attempts.save(directory, tried)
        attempt_folders.keep_best_explosion(directory)
        if record.status in ("straight", "cancelled"):
            break
    record = made[attempt_folders.numbers(directory)[-1]]
    wanted = len(tried) > 1 or request.prefer != COMPUTING
    if record.status != "straight" or not wanted:
        tries.rest()  # what comes out at once is rarely refused
    return {**record.summary(), "attempts": len(tried)}


def choice_of(request: Request, candidates: Candidates) -> Portfolio:
    """What may be tried of a fold."""
    if request.smooth:
        return Portfolio(strategies=(SMOOTHING_WAYS,), seed=request.seed, seeds=1)
    parameters = request.parameters()
    ours = isinstance(parameters.explosion, ExplosionParameters)
    improvements = None
    if request.prefer != COMPUTING:
        hinges = len(candidates.chains[0].folded_rad)
        improvements = Improvements(
            prefer=request.prefer,
            strategies=tuple(
                others_for(chain, parameters, refolds=request.refold) for chain in candidates.chains
            ),
            modules=len(candidates.chains[0]),
            most_frames=0 if request.refold else MAX_SMOOTHED_ANGLES // (DENSER * max(hinges, 1)),
        )
    return Portfolio(
        strategies=tuple(
            strategies_for(chain, parameters, refolds=request.refold) for chain in candidates.chains
        ),
        seed=request.seed,
        two_ended=candidates.two_ended,
        forces=ours,
        seeds=MOST_SEEDS if ours else 1,  # as published there is nothing that a seed changes
        improvements=improvements,
    )


def _begun(directory: FilePath, number: int, chain: Chain) -> FilePath:
    """The folder of an attempt that begins, with its chain and a timeline that is still empty."""
    place = attempt_folders.begin(directory, number)
    write_chain_folded(place, chain)
    TimelineWriter.create(place / attempt_folders.TIMELINE, chain)
    return place


def _smoothed(
    directory: FilePath, request: Request, todo: Try, progress: Report, cancelled: Cancelled
) -> Record:
    """One smoothing, of which there is nothing to see before it is played back."""
    recorded = read_recorded(directory)

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
