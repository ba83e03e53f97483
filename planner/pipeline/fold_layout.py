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
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path as FilePath
from typing import Any, Final, Literal

import numpy as np

from foldback.planner.certificate.figures import CertificateFigures
from foldback.planner.chain.built_in_modules import module_of
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import Module
from foldback.planner.errors import UNREADABLE, InputError, TimelineError
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.timeline import Timeline
from foldback.planner.parameters.parameters import FLOATING
from foldback.planner.pipeline.manifest import read_manifest
from foldback.planner.pipeline.preference import judgement
from foldback.planner.plan.moments import Moments
from foldback.planner.reachability.verdict_figures import VerdictFigures
from foldback.planner.storage import file_names as names
from foldback.planner.storage.files import json_of
from foldback.planner.storage.output_directory import foreign_file, listed_files, replacing
from foldback.planner.storage.plain_values import from_plain

Derived = Literal["figures", "verdict"]
"""What is computed of a fold that is over when somebody asks: figures and moments, or whether turns
lead to its figure."""
MAX_JUDGED_MODULES: Final = 100
"""Maximum number of modules of a figure whose fold's page states a verdict. One of 96 prisms at
random took 4 s of a processor."""


def attempt_numbers(directory: FilePath) -> list[int]:
    """Return the numbers of the attempts that have a folder, in order."""
    try:
        entries = [path.name for path in (directory / names.ATTEMPTS_DIR).iterdir()]
    except OSError:
        return []
    return sorted(int(name) for name in entries if name.isdecimal())


def attempt_dir(directory: FilePath, number: int) -> FilePath:
    """Return the folder of an attempt."""
    return directory / names.ATTEMPTS_DIR / str(number)


def latest_attempt_dir(directory: FilePath) -> FilePath:
    """Return the folder of the latest attempt; the fold's directory when there is none."""
    numbers = attempt_numbers(directory)
    return attempt_dir(directory, numbers[-1]) if numbers else directory


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


def plan_values(path: FilePath) -> dict[str, Any]:
    """Return the values in a plan's ``.npz`` file but for its arrays; none if it is unreadable."""
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return dict(json.loads(str(arrays["plan"])))
    except UNREADABLE:
        return {}


def stored_moments(directory: FilePath) -> Moments | None:
    """Return the moments of a fold that is over; None if none are stored, or they are damaged."""
    try:
        return Moments.from_dict(json_of(directory / names.MOMENTS))
    except (InputError, ValueError):
        return None


def lacks_derived_files(directory: FilePath) -> bool:
    """Return True if figures or moments of a fold that is over have still to be computed.

    False also if they cannot be, without its request or timeline.

    Raises:
        DamagedError: The fold's manifest cannot be read.
    """
    sources = (directory / names.REQUEST, result_path(directory, names.TIMELINE))
    if not all(path.exists() for path in sources):
        return False
    is_played = all((directory / name).exists() for name in (names.PLAN, names.PLAYBACK))
    return _lacks(directory, names.DERIVED_FILES if is_played else (names.FIGURES,))


def stored_verdict(directory: FilePath) -> VerdictFigures | None:
    """Return whether turns lead to the figure of a fold; None if that is not stored."""
    try:
        return from_plain(json_of(directory / names.VERDICT), VerdictFigures)
    except ValueError:
        return None


def judged_module(directory: FilePath) -> Module | None:
    """Return the module of a fold that is over if its figure gets a verdict; None if it does not.

    Verdicts are on figures of chains that turn freely in steps, and begin with the straight chain.
    """
    values = json_of(directory / names.CHAIN)
    if (directory / names.START_CHAIN).exists() or "module" not in values:
        return None
    module, modules = module_of(values["module"]), values.get("modules", 0)
    return module if module.turns_freely_in_steps and 2 < modules <= MAX_JUDGED_MODULES else None


def lacks_verdict(directory: FilePath) -> bool:
    """Return True if the verdict on the figure of a fold that is over has still to be computed.

    Raises:
        InputError: The fold's module cannot be read.
        DamagedError: The fold's manifest cannot be read.
    """
    return judged_module(directory) is not None and _lacks(directory, (names.VERDICT,))


def _lacks(directory: FilePath, expected: Sequence[str]) -> bool:
    listed = read_manifest(directory)
    return not all(
        (directory / name).exists() and (listed is None or name in listed) for name in expected
    )


def any_verified(directory: FilePath) -> bool:
    """Return True if an attempt of a fold that is not over has a verified plan."""
    return any(
        judgement(certificate_values(attempt_dir(directory, number) / names.CERTIFICATE))[0]
        for number in attempt_numbers(directory)
    )


def replacing_fold(directory: FilePath) -> AbstractContextManager[FilePath]:
    """Return the context of a new fold: it yields the folder in which the fold is computed.

    When the context ends without an error, the new fold's files replace those of the fold that is
    in the directory; see ``planner.output_directory.replacing``.

    Raises:
        InputError: Also ``foreign-file`` if files of these names are not those of a fold, or if the
            directory has a tour or values for the fold that is there.
    """
    return replacing(directory, lambda place: [*_earlier_files(place)])


def holds_fold(directory: FilePath) -> bool:
    """Return True if ``foldback fold`` has written into a directory, whether it ended or not."""
    manifest = json_of(directory / names.MANIFEST)
    request = json_of(directory / names.REQUEST)
    return "sha256" in manifest or {"preset", "seed"} <= request.keys()


def _earlier_files(directory: FilePath) -> Iterator[str]:
    """Yield the files of the fold in a directory, and those that were made of its plan.

    Raises:
        InputError: ``foreign-file``.
    """
    files = listed_files(directory)
    yield from files
    if holds_fold(directory / names.FIRST_FOLD_DIR):
        for name in names.FOLD_FILES:
            yield f"{names.FIRST_FOLD_DIR}/{name}"
    if not holds_fold(directory):
        for name in names.FOLD_FILES:
            if name not in files and (directory / name).exists():
                raise foreign_file(directory / name)
        return
    for name in (names.TOUR, names.OWN_VALUES):
        if (directory / name).exists():
            raise InputError(
                "foreign-file",
                f"got a folder with {name}, which belongs to the fold in it. Choose another "
                "folder, or move the file away.",
                where=str(directory),
            )
    yield from names.FOLD_FILES
    if "standing" in json_of(directory / names.TABLE_FILE):
        yield names.TABLE_FILE
