"""Next step: the next computation of a fold, as a function of the attempts so far and nothing else.

A seed always leads to the same plan: no clock, no file and no number of workers is asked. So a
service may stop after any step, and a stage that is run again comes to the same.

An overlap between two frames of the playback may be one of the frames alone, which are joined by
straight lines: the same playback is then recorded with more of them. If a refold's robots still
swing where the chain should be straight, the playback is repeated with less torque near straight.
Everything else is tried with another path, seed or strategy: ``planner.pipeline.retry_policy``.
With a preference it goes on after a verified plan, too: ``planner.pipeline.improvements``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from foldback.planner.pipeline.attempt import Attempt, AttemptSpec, latest_playback
from foldback.planner.pipeline.preference import PlanFigures
from foldback.planner.pipeline.retry_policy import RetryPolicy
from foldback.planner.progress import Report

MAX_REFUSED_EXPLOSIONS: Final = 4
"""Maximum number of explosions of one fold whose plans all fail certification, before the fold
fails."""
MAX_PLAYBACKS_BEFORE_VERIFIED: Final = 6
"""Maximum number of plans of one fold that are played back and certified (checked for collisions
and limits) as long as none passes."""
MAX_PLAYBACKS: Final = 12
"""Maximum number of plans of one fold that are played back and certified, including those that
improve a verified plan."""
REPEATED_PLAYBACK_REFINEMENT: Final = 4
"""Factor by which the number of frames increases when a playback is repeated because its clearance
between two frames was not proved."""
MAX_PATIENCE: Final = 2
"""Maximum number of times that a refold is played back again, each time with less torque near
straight, because its robots were not straight enough there: docs/decisions/0034-calm-motion.md."""
ASSUMED_FIGURES: Final = PlanFigures(
    fold_time_s=None, peak_torque_nm=None, clearance_bound=None, frames=1, seconds=0.0
)
"""Figures that are assumed of a plan which is not computed yet, to tell users about how many plans
a fold is going to try. One frame makes the plan short enough to be smoothed as well."""


@dataclass(frozen=True, slots=True)
class Explode:
    """Explode a chain, or smooth a plan.

    Attributes:
        spec: The try.
    """

    spec: AttemptSpec


@dataclass(frozen=True, slots=True)
class PlayBack:
    """Play the latest record back.

    Attributes:
        finer: Factor of the number of frames.
        patience: Level of slowness near straight: each makes torques there
            ``planner.playback.reference_trajectory.STRAIGHT_TORQUE_RATIO`` times as large.
    """

    finer: int = 1
    patience: int = 0


@dataclass(frozen=True, slots=True)
class Certify:
    """Certify the latest playback."""


Step = Explode | PlayBack | Certify


def next_step(history: Sequence[Attempt], policy: RetryPolicy) -> Step | None:
    """Return the next computation of a fold; None when the search is over.

    Explosions follow each other until one ends straight. When none does, the one that came farthest
    is certified all the same, as a failure; it has no playback, and the step does nothing.

    Args:
        history: Outcomes so far, in order.
        policy: Tries that the fold has.
    """
    if not history:
        return _explode(history, policy)
    last = history[-1]
    if last.failed:
        if (
            played_attempt := next(
                (attempt for attempt in history if attempt.failed and attempt.played), None
            )
        ) is None:
            following = None if last.status == "cancelled" else _explode(history, policy)
            return following or PlayBack()
        return Certify() if played_attempt.verified is None else None
    if not last.played:
        return PlayBack(last.finer, last.patience)
    if last.verified is None:
        return Certify()
    # What was published, or is a baseline, is shown as it is, with what is wrong with it.
    if last.status == "none" or not policy.retries_refused:
        return None
    return _after_verdict(history, policy)


def _after_verdict(history: Sequence[Attempt], policy: RetryPolicy) -> Step | None:
    last = history[-1]
    judged = [attempt for attempt in history if attempt.verified is not None]
    verified = any(attempt.verified for attempt in history)
    if len(judged) >= (MAX_PLAYBACKS if verified else MAX_PLAYBACKS_BEFORE_VERIFIED):
        return None
    if last.between and last.finer == 1:
        return PlayBack(REPEATED_PLAYBACK_REFINEMENT, last.patience)
    # The unfolding of a refold is the same whatever the other shape's path.
    if last.unfolding_overlaps:
        return None
    if last.off_straight:
        patience = last.patience + 1
        return PlayBack(last.finer, patience) if patience <= MAX_PATIENCE else None
    if not verified and _plans(judged) >= MAX_REFUSED_EXPLOSIONS:
        return None
    return _explode(history, policy)


def _explode(history: Sequence[Attempt], policy: RetryPolicy) -> Explode | None:
    spec = policy.next_attempt(history)
    return None if spec is None else Explode(spec)


def with_begun(history: Sequence[Attempt], step: Step) -> tuple[Attempt, ...]:
    """Return the attempts with the one that a step computes.

    It is added by an explosion, and by a playback that is repeated with other settings.
    """
    if isinstance(step, Explode):
        return (*history, Attempt(spec=step.spec, status="begun"))
    if isinstance(step, PlayBack) and history[-1].verified is not None:
        return (*history, history[-1].unjudged(finer=step.finer, patience=step.patience))
    return tuple(history)


def before_explosion(history: Sequence[Attempt], policy: RetryPolicy) -> tuple[Attempt, ...]:
    """Return the attempts that another explosion follows; none when everything begins anew."""
    judged = list(history)
    while judged and judged[-1].verified is None:
        judged.pop()
    return tuple(judged) if judged and isinstance(next_step(judged, policy), Explode) else ()


def before_playback(history: Sequence[Attempt], policy: RetryPolicy) -> tuple[Attempt, ...]:
    """Return the attempts with the one that is to be played back last.

    It is added when the same record is played back with more frames. A playback that is run again
    has no verdict any more.
    """
    if not history or history[-1].verified is None:
        return tuple(history)
    step = next_step(history, policy)
    if isinstance(step, PlayBack):
        return with_begun(history, step)
    return (*history[:-1], history[-1].unjudged())


def with_choice(history: Sequence[Attempt], number: int) -> tuple[Attempt, ...]:
    """Return the attempts with a mark on the one whose plan is the fold's.

    Args:
        history: All attempts of the fold.
        number: The explosion or smoothing whose results are the fold's.
    """
    number_shown = latest_playback(history, number)
    return tuple(replace(attempt, chosen=k == number_shown) for k, attempt in enumerate(history))


def count_plans(history: Sequence[Attempt], policy: RetryPolicy) -> tuple[int, int]:
    """Return the number of the last attempt's plan, from 1, and about how many there will be.

    Args:
        history: Attempts so far; the last one is being computed.
        policy: Tries that the fold has; the total is 0 if nothing follows a verified plan.
    """
    number = _plans(history)
    if policy.improvements is None or not history:
        return number, 0
    figures = next(
        (attempt.figures for attempt in reversed(history) if attempt.figures), ASSUMED_FIGURES
    )
    assumed = replace(history[-1], status="straight", played=True, verified=True, figures=figures)
    ahead = [*history[:-1], assumed]
    while isinstance(step := next_step(ahead, policy), Explode):
        ahead.append(replace(assumed, spec=step.spec, finer=1, patience=0, between=False))
    return number, _plans(ahead)


def with_count(report: Report, history: Sequence[Attempt], policy: RetryPolicy) -> Report:
    """Return a report that adds the plan's number and the total; the same without a preference."""
    number, total = count_plans(history, policy)
    if not total:
        return report
    return lambda progress: report(replace(progress, plan=number, plans=total))


def _plans(history: Sequence[Attempt]) -> int:
    """Return the number of explosions and smoothings; a repeated playback is of the same plan."""
    return sum(not attempt.repeats for attempt in history)
