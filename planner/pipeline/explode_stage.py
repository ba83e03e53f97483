"""The stage that explodes a chain: attempt after attempt, until one ends straight."""

from __future__ import annotations

from typing import Any, Final

from planner.explosion.strategies import others_for, strategies_for
from planner.motion.record import Record
from planner.pipeline import attempts
from planner.pipeline.attempt import Attempt, Candidates, Try
from planner.pipeline.improvements import Improvements
from planner.pipeline.parallel import Tries, make_try
from planner.pipeline.portfolio import MOST_SEEDS, Portfolio
from planner.pipeline.preference import COMPUTING
from planner.pipeline.request import Request
from planner.pipeline.workspace import Workspace
from planner.progress import Cancelled, Progress, Report
from planner.robot import MOST_ANGLES, WAYS
from planner.robot.smoothed import smoothed_record
from planner.simulation.parameters import ExplosionParameters

DENSER: Final = 4
"""Factor of the frames that a plan may get when it is smoothed, peeled ones most."""


def explode_stage(
    workspace: Workspace, progress: Report, cancelled: Cancelled, tries: Tries
) -> dict[str, Any]:
    """Explodes the chain of a fold, or smooths its plan, until one attempt ends straight.

    Args and what it returns: as for ``planner.pipeline.stages.run_stage``.
    """
    request, candidates = workspace.read_request(), workspace.read_candidates()
    choice = choice_of(request, candidates)
    tried = attempts.before_explosion(workspace.read_history(), choice)
    # What an earlier fold left in this directory must not pass for a result of this one.
    if not tried:
        workspace.clear()
    workspace.drop_pictures()
    if request.parameters().explosion is None:
        workspace.begin(0, candidates.chains[0])
        workspace.write_history([])
        return {"status": "none", "reason": "", "steps": 0, "frames": 0, "seconds": 0.0}
    made: dict[int, Record] = {}
    while (todo := choice.after(tried)) is not None:
        number, chain = len(tried), candidates.chain_of(todo)
        place = workspace.begin(number, chain)
        begun = [*tried, Attempt(todo=todo, status="begun")]
        workspace.write_history(begun)
        report = attempts.with_count(progress, begun, choice)
        if request.smooth or todo.smooths is not None:
            if todo.smooths is not None:
                place.write_recorded(workspace.attempt_of(todo.smooths).read_attempt(request))
            record = _smoothed(workspace, request, todo, report, cancelled)
            attempt = attempts.made(todo, chain, record, request.parameters())
        else:
            tries.come_to(choice, tried, todo)
            record, attempt = tries.take(place.timeline, report, cancelled) or make_try(
                place.timeline, request.parameters(), chain, todo, tries.watched(report), cancelled
            )
        place.write_record(record)
        made[number] = record
        tried.append(attempt)
        workspace.write_history(tried)
        workspace.keep_best_explosion()
        if record.status in ("straight", "cancelled"):
            break
    assert workspace.number is not None
    record = made[workspace.number]
    wanted = len(tried) > 1 or request.prefer != COMPUTING
    if record.status != "straight" or not wanted:
        tries.rest()  # what comes out at once is rarely refused
    return {**record.summary(), "attempts": len(tried)}


def choice_of(request: Request, candidates: Candidates) -> Portfolio:
    """What may be tried of a fold."""
    if request.smooth:
        return Portfolio(strategies=(WAYS,), seed=request.seed, seeds=1)
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
            most_frames=0 if request.refold else MOST_ANGLES // (DENSER * max(hinges, 1)),
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


def _smoothed(
    workspace: Workspace, request: Request, todo: Try, progress: Report, cancelled: Cancelled
) -> Record:
    """One smoothing, of which there is nothing to see before it is played back."""
    recorded = workspace.read_recorded()

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
