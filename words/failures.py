"""Failures: the reason why a fold failed and its attempts, in the words of its page."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Final, TypedDict, cast

import numpy as np

from foldback.planner.certificate.figures import (
    AttemptFigures,
    CertificateFigures,
    ExplosionFigures,
    Fault,
    FoldSummary,
)
from foldback.planner.errors import DamagedError
from foldback.planner.motion.failure_schemas import EvidenceFigures
from foldback.planner.reasons import Reader, ReasonCode, ReasonFigures
from foldback.planner.storage.file_names import ATTEMPTS
from foldback.planner.verification.integrity import check
from foldback.web.pictures.knot_drawing import KnotDrawing, drawing_of
from foldback.words.fold import ShownFold
from foldback.words.messages import (
    PEOPLE,
    PEOPLE_WITHOUT_PLACES,
    diagnosis_text,
    nearest_frame,
    reason_text,
)
from foldback.words.quantities import STRATEGY_LABELS, quantity, sentence, spacings, unbroken

FAILURE_HEADINGS: Final = {
    "knot": "The chain is knotted",
    "blocks": "Stalled: modules blocked each other",
    "steps": "Stalled: too many simulation steps",
    "pushes": "Stalled: random pushes on the modules did not help",
    "retries": "The simulation failed",
    "snapshots": "Stalled: too many recorded frames",
    "refusals": "Stalled: torque limit reached",
    "turns": "No sequence of turns was found",
    "turn_steps": "Stalled: the turns take too many steps",
    "motion": "Stalled: nothing moved any more",
    "buried": "Stalled: the modules to be unfolded next were enclosed by other modules",
    "contacts": "Stalled: too many modules pressed against each other",
    "joints": "Stalled: some joints could not turn",
    "broken": "The simulation failed",
    "limit": "Not finished",
    "stopped": "Not finished",
    "blocked": "No single joint can turn",
    "quarter_turns": "No single joint can turn",
    "overlap": "Modules overlap",
    "off": "The chain does not end in its target shape",
    "refused": "Not verified",
}
STAGES_WITH_MOTION: Final = ("explode", "play_back")
"""Stages in which the displayed chain moves, so that the reason of a failure names the frame."""
MAX_BLOCKING_LINES: Final = 24
"""Maximum number of blocked hinge rotations and part movements that the page of a failed fold lists
one by one; further ones are only counted."""
WRONG_END_CODES: Final = frozenset(
    {ReasonCode.PLAN_END, ReasonCode.PLAYBACK_END, ReasonCode.OTHER_ROBOT_END}
)
"""Codes of reasons which say that a chain does not end in its target shape."""
EXPLOSION_ENDS: Final = {
    "stalled": "stalled",
    "timeout": "not straight",
    "diverged": "simulation failed",
    "cancelled": "stopped",
}


class Failure(TypedDict):
    """Reason of a failed fold: texts, its modules, and its frame, None for the last one.

    ``blocks`` has a line for each blocked turn or move; ``knot`` is the drawing of a knot.
    """

    heading: str
    text: str
    modules: list[int]
    frame: float | None
    blocks: list[str]
    knot: KnotDrawing | None


class AttemptWords(TypedDict):
    """One attempt in words, and the colour class of its result."""

    strategy: str
    how: str
    end: str
    tone: str


class _Overlap(TypedDict):
    """Modules, frame and description of an overlap."""

    modules: list[int] | None
    frame: float
    words: str


def failure(row: ShownFold, summary: FoldSummary) -> Failure | None:
    """Return the reason of a failed fold; None for others, including cancelled ones."""
    if row.status != "failed":
        return None
    frame: float | None = None
    evidence: EvidenceFigures | None = None
    if stuck := summary.get("stuck"):
        kind, modules = stuck["kind"], stuck["modules"]
        text = diagnosis_text(stuck)
        if kind == "stopped":
            text = _stopped(row, text)
        if evidence := stuck.get("evidence"):
            kind = evidence["spent"] if evidence["kind"] == "budget" else evidence["kind"]
    elif overlap := _overlap(summary):
        kind, modules, text = "overlap", overlap["modules"] or [], overlap["words"]
        frame = overlap["frame"] + (exploding(summary) or 0)
    elif refusal := refusal_of(summary):
        modules, text = [], refusal_text(refusal, summary)
        kind = "off" if refusal["code"] in WRONG_END_CODES else "refused"
    else:
        return None
    text = sentence(text.rstrip("."))
    return {
        "heading": FAILURE_HEADINGS[kind],
        "text": unbroken(f"{text}."),
        "modules": modules,
        "frame": frame,
        "blocks": _blocks(evidence) if evidence else [],
        "knot": drawing_of(evidence) if evidence and evidence["kind"] == "knot" else None,
    }


def _blocks(evidence: EvidenceFigures) -> list[str]:
    """Return a line for each blocked turn and each blocked move; none for another reason."""
    lines: list[str] = []
    if evidence["kind"] == "knot" or evidence["kind"] == "budget":
        return lines
    for turn in evidence["turns"]:
        degrees, (a, b) = float(np.rad2deg(turn["turned_rad"])), turn["modules"]
        # A hinge that must straighten can turn in one direction only.
        sign = "" if evidence["kind"] == "blocks" else "−" if degrees < 0.0 else "+"
        lines.append(
            f"If hinge {turn['hinge']} at module {turn['module'] + 1} turns by "
            f"{sign}{abs(degrees):.0f}°, "
            f"modules {a + 1} and {b + 1} overlap by {spacings(turn['overlap'], 2)}"
        )
    for move in evidence["moves"] if evidence["kind"] == "blocks" else ():
        axis = next(k for k, step in enumerate(move["direction"]) if step)
        way = f"{'+' if move['direction'][axis] > 0 else '−'}{'xyz'[axis]}"
        a, b = move["modules"]
        lines.append(
            f"If the part that unfolds next moves by {spacings(move['moved'])} along {way}, "
            f"modules {a + 1} and {b + 1} overlap by {spacings(move['overlap'], 2)}"
        )
    excess = len(lines) - MAX_BLOCKING_LINES
    return (
        lines
        if excess <= 0
        else [
            *lines[:MAX_BLOCKING_LINES],
            f"{excess} more motion{'s are' if excess > 1 else ' is'} blocked in the same way",
        ]
    )


def exploding(summary: FoldSummary) -> int | None:
    """Return the number of explosion frames before the plan on a timeline; None if unknown."""
    # The timeline of a refold or of a smoothed plan has no explosion.
    if summary.get("refold") or summary.get("smoothing"):
        return 0
    return (summary.get("explosion") or ExplosionFigures()).get("frames")


def refusal_of(summary: FoldSummary) -> ReasonFigures | None:
    """Return the reason why a plan is not verified; None if it is, or if there is no plan."""
    return (summary.get("certificate") or CertificateFigures()).get("reason")


def timeline_reader(summary: FoldSummary) -> Reader:
    """Return the style of reasons whose frames are counted along the timeline of a fold."""
    explosion = exploding(summary)

    def on_the_timeline(frame: float, motion: str) -> str:
        del motion  # all motions of the plan have the same frames
        # Without the explosion's frames, only the text's percentage states the position.
        return "" if explosion is None else f" (frame {nearest_frame(explosion + frame) + 1})"

    return replace(PEOPLE, place=on_the_timeline)


def refusal_text(refusal: ReasonFigures, summary: FoldSummary) -> str:
    """Return the reason why a plan is not verified, with frames counted along the timeline."""
    return reason_text(refusal, timeline_reader(summary))


def collision(summary: FoldSummary) -> str | None:
    """Return which modules of a refused plan collide, and where; None for another reason."""
    refusal = refusal_of(summary)
    if refusal is None or refusal["code"] != ReasonCode.OVERLAP:
        return None
    values = refusal["values"]
    modules = values.get("modules")
    names = "modules" if not modules else f"modules {modules[0] + 1} and {modules[1] + 1}"
    simulated = "" if values.get("motion") == "plan" else " in the simulation,"
    progress = 100.0 * values.get("progress", 0.0)
    return f"{names} collide{simulated} {progress:.0f} % through the motion"


def reason_words(row: ShownFold, summary: FoldSummary) -> str | None:
    """Return the reason why a fold failed; None if none is recorded."""
    if (refusal := refusal_of(summary)) is not None:
        return refusal_text(refusal, summary)
    error = row.error or Fault()
    return error.get("message") or error.get("detail") or summary.get("reason")


def _stopped(row: ShownFold, words: str) -> str:
    """Return the external reason that ended a fold, and its state at that time."""
    detail = (row.error or Fault()).get("detail")
    parts = [str(detail)] if detail else []
    if row.stage is None or row.stage in STAGES_WITH_MOTION:
        parts.append(words)
    return ". ".join(sentence(part.rstrip(".")) for part in parts)


def _overlap(summary: FoldSummary) -> _Overlap | None:
    """Return the overlap for which a plan was refused."""
    certificate = summary.get("certificate") or CertificateFigures()
    for motion, clearance, place in (
        ("the plan", certificate.get("min_clearance"), certificate.get("min_clearance_at")),
        (
            "the simulated folding motion",
            certificate.get("min_clearance_playback"),
            certificate.get("min_clearance_playback_at"),
        ),
    ):
        if clearance is None or clearance >= 0.0 or not place:
            continue
        modules = place["modules"]
        module_words = (
            "modules" if not modules else f"modules {modules[0] + 1} and {modules[1] + 1}"
        )
        size = quantity(100.0 * (certificate.get("module_size") or 0.0), "%")
        return {
            "modules": modules,
            "frame": place["frame"],
            "words": f"in {motion}, {module_words} overlap by {spacings(-clearance)} "
            f"(each module fills {size} of the spacing)",
        }
    return None


def tightest_frame(summary: FoldSummary) -> float | None:
    """Return the frame of the timeline with the plan's smallest clearance; None if unknown.

    For a plan that was refused because of an overlap, return the frame of this overlap.
    """
    place = (summary.get("certificate") or CertificateFigures()).get("min_clearance_at")
    frame = overlap["frame"] if (overlap := _overlap(summary)) else place and place["frame"]
    before = exploding(summary)
    return None if frame is None or before is None else before + frame


def attempts(directory: Path) -> list[AttemptWords]:
    """Return the attempts of a fold in order: their strategies and results."""
    try:
        check(directory, ATTEMPTS)
        figures = json.loads((directory / ATTEMPTS).read_bytes())
    except (DamagedError, OSError, ValueError):
        return []
    return [_attempt(attempt) for attempt in cast("list[AttemptFigures]", figures)]


def _attempt(attempt: AttemptFigures) -> AttemptWords:
    path = f"path {attempt['candidate'] + 1}"
    if attempt.get("other_end"):
        path += " from the other end"
    traits = [path, f"seed {attempt['seed']}"]
    if attempt.get("gentle"):
        traits.append("with half the force")
    if attempt.get("roomy"):
        traits.append("only turns with the most room")
    if attempt.get("plain"):
        traits.append("with hinges that turn more freely")
    if (smooths := attempt.get("smooths")) is not None:
        traits.append(f"smoothed version of attempt {smooths + 1}")
    if "finer" in attempt:
        traits.append("folded in a larger number of smaller steps")
    if "patience" in attempt:
        traits.append("folded more slowly near straight")
    refusal = attempt.get("refusal")
    status = str(attempt["status"])
    tone = "off"
    if status == "begun":
        end = "interrupted"
    elif status != "straight":
        steps = f"{EXPLOSION_ENDS.get(status, status)} after {quantity(attempt['steps'])} steps"
        diagnosis = attempt.get("diagnosis")
        words = diagnosis_text(diagnosis) if diagnosis else ""
        end, tone = f"{steps}: {words}" if words else steps, "bad"
    elif attempt.get("verified"):
        end, tone = "verified", "good"
    elif refusal is not None:
        end, tone = reason_text(refusal, PEOPLE_WITHOUT_PLACES), "bad"
    else:
        end = "unfolded, not checked"
    return {
        "strategy": STRATEGY_LABELS.get(str(attempt["strategy"]), str(attempt["strategy"])),
        "how": sentence(", ".join(traits)),
        "end": sentence(end),
        "tone": tone,
    }
