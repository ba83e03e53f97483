"""Layout of a fold's directory: file names, and the place of each result while a fold is computed.

``attempts/2`` holds the chain, timeline, record, playback and certificate of the explosion that is
entry 2 of ``attempts.json``. When the fold is over, the files of the best attempt are in the fold's
directory itself. ``plans/2`` holds the files from which a page plays the verified plan of entry 2,
which was not chosen.

Servers load this module without any that computes; ``planner.pipeline.workspace`` reads and writes
the files as typed values.
"""

from __future__ import annotations

import json
from pathlib import Path as FilePath

from planner import file_names as names
from planner.certificate.figures import CertificateFigures
from planner.chain.chain import Chain
from planner.errors import UNREADABLE, InputError, TimelineError
from planner.files import json_of
from planner.motion.motion import Motion
from planner.motion.timeline import Timeline
from planner.parameters.parameters import FLOATING
from planner.pipeline.preference import judgement
from planner.plan.moments import Moments


def attempt_numbers(directory: FilePath) -> list[int]:
    """Return the numbers of the attempts that have a folder, in order."""
    try:
        found = [path.name for path in (directory / names.ATTEMPTS_DIR).iterdir()]
    except OSError:
        return []
    return sorted(int(name) for name in found if name.isdecimal())


def attempt_dir(directory: FilePath, number: int) -> FilePath:
    """Return the folder of an attempt."""
    return directory / names.ATTEMPTS_DIR / str(number)


def latest_attempt_dir(directory: FilePath) -> FilePath:
    """Return the folder of the latest attempt; the fold's directory when there is none."""
    known = attempt_numbers(directory)
    return attempt_dir(directory, known[-1]) if known else directory


def result_path(directory: FilePath, name: str) -> FilePath:
    """Return the path of a file of ``RESULT_FILES``, also while the fold is computed.

    The file need not be there.
    """
    path = latest_attempt_dir(directory) / name
    return path if path.exists() else directory / name


def is_on_table(directory: FilePath) -> bool:
    """Return True if the fold in a directory is on a table; False if unknown."""
    return json_of(directory / names.REQUEST).get("world", FLOATING) != FLOATING


def last_frame(timeline: FilePath) -> tuple[Chain, Motion] | None:
    """Return a timeline's chain and last frame; None when it has none."""
    try:
        opened = Timeline.open(timeline)
        return (opened.chain, opened.frames(len(opened) - 1)) if len(opened) else None
    except (TimelineError, OSError, ValueError, KeyError):
        return None


def certificate_values(path: FilePath) -> CertificateFigures | None:
    """Return the figures of a certificate's file; None when there is none."""
    return json.loads(path.read_bytes()) if path.exists() else None


def stored_moments(directory: FilePath) -> Moments | None:
    """Return the moments of a fold that is over; None if none are stored, or they are damaged."""
    try:
        return Moments.from_dict(json.loads((directory / names.MOMENTS).read_bytes()))
    except (InputError, *UNREADABLE):
        return None


def any_verified(directory: FilePath) -> bool:
    """Return True if an attempt of a fold that is not over has a verified plan."""
    return any(
        judgement(certificate_values(attempt_dir(directory, number) / names.CERTIFICATE))[0]
        for number in attempt_numbers(directory)
    )
