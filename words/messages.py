"""Messages for people: error texts, "got X, expected Y; do Z", and reasons as plain sentences."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Final

from foldback.planner.explosion.diagnosis import Diagnosis
from foldback.planner.motion.failure_schemas import StuckFigures
from foldback.planner.reasons import Reader, Reason, ReasonFigures
from foldback.planner.storage.plain_values import from_plain
from foldback.words.quantities import spacings

GOT_EXPECTED: Final = re.compile(
    r"\bgot (?P<got>.+?), expected (?P<expected>(?:[^;.]|\.(?=\d))+)", re.DOTALL
)
GOT: Final = re.compile(r"\bgot (?=\S)")
WRONG_KIND: Final = re.compile(
    r"this looks like (?P<kind>.+?), expected (?P<expected>.+)\.$", re.DOTALL
)
COMMON_FORMATS: Final = "a mesh (STL, OBJ, PLY, OFF, GLB or 3MF), a voxel model, a path or a chain"
"""Formats that a message for people lists; programs get the names of all formats."""
ALL_FORMATS: Final = re.compile(r"a mesh \(STL.* foldback-chain/1 .*\)", re.DOTALL)
"""Matches the list of all formats in a message for programs, ``READABLE_FORMATS``."""
MESSAGES: Final = (
    (
        re.compile(r"got a mesh without triangles, .*"),
        "This mesh has no triangles. Save it again as a closed surface.",
    ),
    (re.compile(r"Not Found"), "There is nothing at this address."),
    (re.compile(r"got an empty file\b.*"), "This file is empty."),
    (
        re.compile(r"got 0 angles, expected (?:at least \d+|\d+ angles? for each joint)\b.*"),
        "Type at least one 0 (straight), + or − (bent).",
    ),
    (
        re.compile(
            r"(?:character \d+: )?got (?P<sign>.+?) after \d+ angles, expected 0, \+ or -.*"
        ),
        '"{sign}" isn\'t an angle. Use 0 (straight), + or − (bent) for each hinge.',
    ),
)
"""Messages for people for the most frequent input errors: a pattern that matches the whole error
text, and the message that replaces it."""
NUMBERED_PARTS: Final = re.compile(
    r"\b(?:module|cell|angle|triangle)s? \d+\b(?:(?:, | and | to | against )\d+\b)*(?: more)?",
    re.IGNORECASE,
)
"""Matches mentions of numbered parts of an input in a text ("module 3", "cells 1, 2 and 14 more"),
with the count that shortens a long list. Their numbers, counted from 0, are increased by 1 for
display."""


def count_from_one(text: str) -> str:
    """Return a text of the planner with modules and cells counted from 1 instead of 0.

    ``countFromOne`` in ``lib/api.js`` does the same.
    """
    return NUMBERED_PARTS.sub(
        lambda named: re.sub(r"\d+(?! more)\b", lambda index: str(int(index[0]) + 1), named[0]),
        text,
    )


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


def message_for_people(detail: str) -> str:
    """Return an error's detail as sentences for people; the API keeps the detail itself.

    Args:
        detail: The error as programs get it: value found, value expected, remedy.
    """
    for pattern, message in MESSAGES:
        if match := pattern.fullmatch(detail):
            return message.format(**match.groupdict())
    if match := WRONG_KIND.fullmatch(detail):
        expected = ALL_FORMATS.sub(COMMON_FORMATS, match["expected"])
        return f"This looks like {match['kind']}. Please use {expected}."
    text = GOT_EXPECTED.sub(r"expected \g<expected>, but found \g<got>", detail)
    text = GOT.sub("found ", text)
    head, separator, advice = text.partition("; ")
    if separator:
        text = f"{head}. {advice[:1].upper()}{advice[1:]}"
    return text[:1].upper() + text[1:]
