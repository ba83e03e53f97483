"""Messages for people: error texts, "got X, expected Y; do Z", and verdicts as plain sentences."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Final

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
FRAME: Final = re.compile(r"\b(?P<word>[Ff]rame) (?P<frame>\d+(?:\.\d+)?)\b")
"""Matches a frame in a verdict, counted from 0; a fraction is a moment between two frames."""
PITCHES: Final = re.compile(r"(?<![\w.])(?P<pitches>-?\d+(?:\.\d+)?(?:e[-+]?\d+)?) pitch(?:es)?\b")
"""Matches a length in a verdict."""
VERDICT_PHRASES: Final = (
    (re.compile(r"(?<=\)), the torque limit\. Try\b"), ", which is the torque limit. Try"),
    (
        re.compile(
            r"\ba robot lost its target: (\S+ is off by \S+ rad), more than its motor can correct, "
            r"(\d+ % into the fold)"
        ),
        r"a robot could not follow the motion: \2, \1, which is more than its motor can correct",
    ),
    (
        re.compile(
            r"(\S+) yielded: it is (off by \S+ rad) with motors of (\S+ w·p), "
            r"(\d+ % into the fold)"
        ),
        r"the motor of \1 is too weak: it supplies at most \3 (module weight × "
        r"spacing), and \4, the joint is \2",
    ),
    (re.compile(r"(?<=\d %) into the fold\b"), " through the motion"),
    (
        re.compile(
            r"(\d+ %) through the motion, (\S+) is off by (\S+ rad), which is more than its "
            r"motor can correct\b"
        ),
        r"after \1 of the motion, the angle of \2 was off by \3, more than its motor could correct",
    ),
    (
        re.compile(r", and (\d+ %) through the motion, the joint is off by (?=\S+ rad\b)"),
        r". After \1 of the motion, the angle of this joint was off by ",
    ),
    (re.compile(r"(?<=knotted) \(determinant 1\)"), ""),
    (
        re.compile(r"(?<=knotted \()determinant (\d+)(?=\))"),
        r"the knot's determinant is \1; that of a chain without a knot is 1",
    ),
    (
        re.compile(r"\bdrawn as it stalled, with its ends extended outwards, it has (?=\d)"),
        "a drawing of the stalled chain, with both ends extended outwards, has ",
    ),
    (
        re.compile(r"\b(\d[\d\xa0]*) random pushes in a row, the limit, made no progress"),
        r"the limit of \1 random pushes in a row without progress was reached",
    ),
    (
        re.compile(r"\bwas exceeded ([\d\xa0]+) times; ([\d\xa0]+) times are allowed\b"),
        r"was exceeded \1 times, but only \2 times are allowed",
    ),
    (
        re.compile(r"\bthe (\d+) hinges (bent .+?°) at (.+?) cannot straighten, each by itself: "),
        r"none of the \1 hinges \2 (at \3) can straighten by itself, "
        "because modules would overlap: ",
    ),
    (
        re.compile(r"(?<=\S) cannot straighten: (?=module)"),
        " cannot straighten, because modules would overlap: ",
    ),
    (
        re.compile(r"\b(modules \d+ to \d+), which come next, (cannot move in any .+?): "),
        r"the part that would unfold next (\1) \2, because modules would overlap: ",
    ),
    (re.compile(r"\bmodule (\d+) against (?=\d)"), r"modules \1 and "),
    (re.compile(r"\b1 pairs more\b"), "1 more pair"),
    (re.compile(r"\b(\d+) pairs more\b"), r"\1 more pairs"),
    (re.compile(r"\(module weight × pitch\)"), "(module weight × spacing)"),
    (
        re.compile(r"\bthe chain ended (\S+ pitches) \(RMS\) from its target\b"),
        r"the modules ended \1 from their targets on average (root mean square)",
    ),
    (
        re.compile(r"(?<= steps): it is (\S+ pitches) \(RMS\) away, and (?=\d)"),
        r": the modules are \1 from their targets on average (root mean square), and ",
    ),
    (re.compile(r" \(RMS\)"), " on average (root mean square)"),
)
"""Patterns in verdicts, and the words that replace them for people. Plans store the verdicts, and
``foldback verify`` compares them, so the verdicts themselves keep their text."""

ASSUMPTION_PHRASES: Final = (
    (
        "The torque of a frame is the largest joint torque, minimised over all distributions of "
        "contact forces. This lower bound is exact",
        "The contact forces are distributed so that the largest joint torque of a frame is as "
        "small as possible. This lower bound of the torque is exact",
    ),
    (
        "Linked cubes do not touch: the parts that would touch are cut away.",
        "The parts of linked cubes that would touch are treated as cut away.",
    ),
    ("any moment across their hinges", "any moment perpendicular to their hinge axes"),
    ("The chain lies free on the table.", "The chain lies on the table and is not clamped."),
    (
        "It drifts so that friction does the least work, computed with the contact forces of a "
        "table without friction.",
        "The chain drifts so that friction does the least work. The drift is computed with the "
        "contact forces that the chain would have on a table without friction.",
    ),
    (
        "opposes the motion to the next frame",
        "opposes the motion that leads to the next frame",
    ),
    (
        "Each frame was laid down in the resting pose that needs the least torque; the motion from "
        "one pose to the next is not checked.",
        "For this check, the chain of each frame was laid on the table in the resting pose that "
        "needs the least torque. The motion from one resting pose to the next is not checked.",
    ),
)
"""Parts of a table certificate's assumptions, and the words that replace them for people. Plans
store the assumptions, so these keep their text."""


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


def verdict_for_people(verdict: str) -> str:
    """Return a stored verdict, or its reason, in words for people.

    Modules, cells and frames count from 0 in a stored verdict, and from 1 in the result.
    """
    verdict = FRAME.sub(
        lambda found: f"{found['word']} {nearest_frame(float(found['frame'])) + 1}",
        count_from_one(verdict),
    )
    for pattern, words in VERDICT_PHRASES:
        verdict = pattern.sub(words, verdict)
    return PITCHES.sub(lambda length: spacings(float(length["pitches"])), verdict)


PEOPLE: Final = Reader(
    first=1,
    length=spacings,
    frame=lambda frame: str(nearest_frame(frame) + 1),
    place=lambda frame, motion: f" (frame {nearest_frame(frame) + 1} of the {motion})",
    detail=verdict_for_people,
)
"""Style of reasons for people: numbers count from 1, lengths are shares of the spacing."""


def _no_place(frame: float, motion: str) -> str:
    del frame, motion
    return ""


PEOPLE_WITHOUT_PLACES: Final = replace(PEOPLE, place=_no_place)
"""The same, without the frames of a motion."""


def assumption_for_people(assumption: str) -> str:
    """Return a stored assumption of a table's certificate in the words that people read."""
    for stored, words in ASSUMPTION_PHRASES:
        assumption = assumption.replace(stored, words)
    return assumption


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
