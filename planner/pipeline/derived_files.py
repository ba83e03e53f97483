"""Derived files: figures and moments of a finished fold, computed when somebody asks for them.

A fold ends without them. They are believed only if the fold's manifest lists their digests, which
are added when they are computed; others are computed again.
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory

from foldback.planner.certificate.frame_figures import write_figures
from foldback.planner.motion.timeline import Timeline
from foldback.planner.pipeline import manifest
from foldback.planner.pipeline.fold_layout import lacks_derived_files, result_path
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.moment_search import moments_of
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.steps import find_steps
from foldback.planner.storage.file_names import (
    DERIVED_FILES,
    FIGURES,
    FORCES,
    MOMENTS,
    PLAN,
    RECORD,
    TIMELINE,
)
from foldback.planner.storage.files import refuses_writing, write_json


def complete(directory: FilePath) -> None:
    """Write the figures and moments of a fold that is over, unless they are there.

    Raises:
        TimelineError: The fold has no timeline, or it is damaged.
        InputError: Its plan cannot be read.
    """
    if not lacks_derived_files(directory):
        return
    _write(directory, directory)
    manifest.add_to_manifest(directory, DERIVED_FILES)


@contextmanager
def completed(directory: FilePath) -> Generator[FilePath]:
    """Yield the directory that holds the figures and moments of a fold that is over.

    It is the fold's own, or a temporary one if that cannot be written.

    Raises:
        TimelineError, InputError: As ``complete``.
    """
    if not lacks_derived_files(directory):
        yield directory
    elif not refuses_writing(directory):
        complete(directory)
        yield directory
    else:
        with TemporaryDirectory(prefix="foldback-") as place:
            _write(directory, FilePath(place))
            yield FilePath(place)


def _write(directory: FilePath, target: FilePath) -> None:
    """Write the figures and moments of a fold into a directory."""
    workspace = Workspace(directory)
    timeline = result_path(directory, TIMELINE)
    certificate, playback = workspace.read_certificate(), workspace.read_playback()
    write_figures(
        timeline,
        target / FIGURES,
        workspace.read_request().parameters(Timeline.open(timeline).chain.module),
        certificate=certificate,
        plan=None if playback is None else playback.reference,
    )
    if certificate is None or not (directory / PLAN).exists():
        return
    moments = moments_of(
        Timeline.open(timeline),
        module_size=certificate.module_size,
        figures=target / FIGURES,
        forces=result_path(directory, FORCES),
        direct=result_path(directory, RECORD).exists(),
        steps=find_steps(Plan.load(directory / PLAN)),
    )
    if moments is not None:
        write_json(target / MOMENTS, moments.as_dict())
