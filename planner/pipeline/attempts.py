"""Attempts: what may be tried of a fold, what was, and what comes next when a certificate fails.

An overlap between two frames of the playback may be one of the frames alone, which are joined by
straight lines: the same playback is then recorded with more of them. Everything else is tried with
another path, seed or strategy: ``planner.pipeline.portfolio``. With a wish it goes on after a
verified plan, too: ``planner.pipeline.improvements``.

``attempts.json`` in a fold's directory is a list with an entry for each explosion or smoothing, and
one for each playback with finer frames. An entry has no verdict until its certificate is there; a
stage that is run again drops what it had added and comes to the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, Literal

from planner.certificate.certificate import Certificate
from planner.chain.chain import Chain
from planner.explosion.diagnosis import diagnose
from planner.motion.record import Record
from planner.pipeline.attempt import Attempt, Try
from planner.pipeline.portfolio import Portfolio
from planner.pipeline.preference import PlanFigures
from planner.playback.playback import Playback
from planner.progress import Report
from planner.simulation.parameters import Parameters

MOST_JUDGED: Final = 6
"""Playbacks of one fold that get a certificate, at most, before one is verified."""
MOST_JUDGED_IN_ALL: Final = 12
"""The same with those that are tried for a wish after that."""
MOST_REFUSED: Final = 4
"""Explosions of one fold whose plans may be refused before one is verified."""
FINER: Final = 4
"""Factor of the frames of a playback that is repeated with more of them."""
ASSUMED: Final = PlanFigures(
    fold_time_s=None, peak_torque_nm=None, clearance_bound=None, frames=1, seconds=0.0
)
"""Figures of a plan that is not judged yet. With one frame it counts as one that is smoothed."""
VERIFIED: Final = "verified"


def made(todo: Try, chain: Chain, record: Record, parameters: Parameters) -> Attempt:
    """One that came to an end of its own."""
    return Attempt(
        todo=todo,
        status=record.status,
        reason=record.reason,
        steps=record.steps,
        frames=len(record.frames),
        seconds=record.seconds,
        diagnosis=diagnose(chain, record, parameters),
    )


def before_explosion(attempts: Sequence[Attempt], choice: Portfolio) -> list[Attempt]:
    """Attempts that another explosion follows; none when everything begins anew."""
    kept = list(attempts)
    while kept and kept[-1].verdict is None:
        kept.pop()
    goes_on = bool(kept) and following(kept, choice) == "explode"
    return kept if goes_on else []


def before_playback(attempts: Sequence[Attempt], choice: Portfolio) -> list[Attempt]:
    """Attempts with the one that is to be played back last."""
    if attempts and attempts[-1].verdict is not None:
        again = replace(attempts[-1], verdict=None, figures=None, between=False)
        if following(attempts, choice) == "play_back":
            return [*attempts, replace(again, finer=FINER)]
        return [*attempts[:-1], again]
    return list(attempts)


def judged(
    attempts: Sequence[Attempt],
    certificate: Certificate,
    number: int | None,
    playback: Playback | None = None,
) -> list[Attempt]:
    """With the verdict on an explosion and on its latest playback.

    Args:
        attempts: All of the fold.
        certificate: The verdict, and where the plan is narrowest.
        number: Which explosion it is of; None for the last one.
        playback: What it has looked at.
    """
    judged = _latest(attempts, len(attempts) - 1 if number is None else number)
    place = certificate.min_clearance_playback_at
    between = (
        certificate.min_clearance is not None
        and certificate.min_clearance >= 0.0
        and certificate.min_clearance_playback is not None
        and certificate.min_clearance_playback < 0.0
        and place is not None
        and not float(place.frame).is_integer()
    )
    exploding_s = attempts[judged].seconds if attempts[judged].finer == 1 else 0.0
    playing_s = 0.0 if playback is None else playback.seconds
    after = replace(
        attempts[judged],
        verdict=certificate.verdict,
        figures=PlanFigures.of(certificate.as_dict(), before_s=exploding_s + playing_s),
        between=between,
    )
    return [*attempts[:judged], after, *attempts[judged + 1 :]]


def marked(attempts: Sequence[Attempt], number: int) -> list[Attempt]:
    """With a mark on the one whose plan is the fold's.

    Args:
        attempts: All of the fold.
        number: The explosion or smoothing whose files are kept.
    """
    chosen = _latest(attempts, number)
    return [replace(attempt, chosen=k == chosen) for k, attempt in enumerate(attempts)]


def _latest(attempts: Sequence[Attempt], number: int) -> int:
    """The latest playback of an explosion."""
    while number + 1 < len(attempts) and attempts[number + 1].finer > 1:
        number += 1
    return number


def following(
    attempts: Sequence[Attempt], choice: Portfolio
) -> Literal["explode", "play_back"] | None:
    """The stage that goes on after the verdict on the last attempt; None when that is the end."""
    last = attempts[-1]
    if last.verdict is None or last.status != "straight":
        return None
    verdicts = [attempt for attempt in attempts if attempt.verdict is not None]
    refused = sum(attempt.finer == 1 for attempt in verdicts)
    verified = any(attempt.verified for attempt in attempts)
    if len(verdicts) >= (MOST_JUDGED_IN_ALL if verified else MOST_JUDGED):
        return None
    if last.between and last.finer == 1:
        return "play_back"
    if refused >= MOST_REFUSED and not verified:
        return None
    return "explode" if choice.after(attempts) is not None else None


def count_plans(tried: Sequence[Attempt], choice: Portfolio) -> tuple[int, int]:
    """Return the number of the last attempt's plan, from 1, and about how many there will be.

    Args:
        tried: The attempts so far; the last one is being computed.
        choice: What may be tried after them; the total is 0 if nothing follows a verified plan.
    """
    number = _plans(tried)
    if choice.improvements is None or not tried:
        return number, 0
    figures = next((each.figures for each in reversed(tried) if each.figures), ASSUMED)
    assumed = replace(tried[-1], status="straight", verdict=VERIFIED, figures=figures)
    ahead = [*tried[:-1], assumed]
    while following(ahead, choice) == "explode" and (todo := choice.after(ahead)):
        ahead.append(replace(assumed, todo=todo, finer=1, between=False))
    return number, _plans(ahead)


def with_count(report: Report, tried: Sequence[Attempt], choice: Portfolio) -> Report:
    """Return a report that adds the plan's number and the total; the same without a preference."""
    number, total = count_plans(tried, choice)
    if not total:
        return report
    return lambda progress: report(replace(progress, plan=number, plans=total))


def _plans(tried: Sequence[Attempt]) -> int:
    """Return the number of explosions and smoothings; a finer playback is of the same plan."""
    return sum(attempt.finer == 1 for attempt in tried)
