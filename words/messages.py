"""Reasons as people read them: numbers count from 1, lengths are shares of the spacing."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from foldback.planner.explosion.failure_evidence import Diagnosis
from foldback.planner.motion.failure_schemas import StuckFigures
from foldback.planner.reasons import Reader, Reason, ReasonFigures
from foldback.planner.storage.plain_values import from_plain
from foldback.words.quantities import spacings


def nearest_frame(frame: float) -> int:
    """Return the frame that pages show for a moment between frames: halves are rounded up."""
    return math.floor(frame + 0.5)


def reason_text(reason: Reason | ReasonFigures, reader: Reader | None = None) -> str:
    """Return a reason for people, with modules and frames counted from 1."""
    value = reason if isinstance(reason, Reason) else from_plain(reason, Reason)
    return value.text(reader or PEOPLE)


PEOPLE: Final = Reader(
    first=1,
    length=spacings,
    frame=lambda frame: str(nearest_frame(frame) + 1),
    place=lambda frame, motion: f" (frame {nearest_frame(frame) + 1} of the {motion})",
    unfolding="unfolding",
    folding="folding motion",
)
"""Style of reasons for people: numbers count from 1, lengths are shares of the spacing."""


def _no_place(frame: float, motion: str) -> str:
    del frame, motion
    return ""


PEOPLE_WITHOUT_PLACES: Final = replace(PEOPLE, place=_no_place)
"""The same, without the frames of a motion."""


def diagnosis_text(diagnosis: StuckFigures) -> str:
    """Return the reason of a stalled explosion for people, with modules counted from 1."""
    return Diagnosis.from_dict(diagnosis).text(PEOPLE)
