"""Derived files: figures, moments and verdict of a finished fold, computed when somebody asks.

A fold ends without them. They are believed only if the fold's manifest lists their digests, which
are added when they are computed; others are computed again.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from typing import Final

from foldback.planner.certificate.frame_figures import write_figures
from foldback.planner.motion.timeline import Timeline
from foldback.planner.pipeline import manifest
from foldback.planner.pipeline.fold_layout import (
    Derived,
    lacks_derived_files,
    lacks_verdict,
    result_path,
)
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.moment_search import moments_of
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.steps import find_steps
from foldback.planner.reachability.deciding import Decider
from foldback.planner.reachability.exhaustion_file import write_exhaustion
from foldback.planner.storage.file_names import (
    DERIVED_FILES,
    EXHAUSTION,
    FIGURES,
    FORCES,
    MOMENTS,
    PLAN,
    RECORD,
    TIMELINE,
    VERDICT,
    VERDICT_FILES,
)
from foldback.planner.storage.files import refuses_writing, write_json, write_whole
from foldback.planner.storage.plain_values import to_plain


def complete(directory: FilePath, derived: Derived = "figures") -> None:
    """Write files that are derived from a fold that is over, unless they are there.

    Raises:
        TimelineError: The fold has no timeline, or it is damaged.
        InputError: Its plan cannot be read, or its figure is not one that gets a verdict.
    """
    kind = _KINDS[derived]
    if kind.lacks(directory):
        kind.write(directory, directory)
        manifest.add_to_manifest(directory, kind.files)


@contextmanager
def completed(directory: FilePath, derived: Derived = "figures") -> Generator[FilePath]:
    """Yield the directory that holds files that are derived from a fold that is over.

    It is the fold's own, or a temporary one if that cannot be written.

    Raises:
        TimelineError, InputError: As ``complete``.
    """
    kind = _KINDS[derived]
    if not kind.lacks(directory):
        yield directory
    elif not refuses_writing(directory):
        complete(directory, derived)
        yield directory
    else:
        with TemporaryDirectory(prefix="foldback-") as place:
            kind.write(directory, FilePath(place))
            yield FilePath(place)


def _write_figures(directory: FilePath, target: FilePath) -> None:
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


def write_verdict(directory: FilePath, target: FilePath) -> None:
    """Write whether turns lead to the figure of a fold into a directory, and the proof if not.

    Raises:
        InputError: Its figure is not one that gets a verdict.
    """
    chain = Workspace(directory).read_chain()
    decision = Decider(chain.module, chain.folded_rad).verdict()
    if decision.exhaustion is None:
        (target / EXHAUSTION).unlink(missing_ok=True)
    else:
        proof = write_exhaustion(
            chain.module, decision.exhaustion, figure=decision.figure, goal=decision.goal
        )
        write_whole(target / EXHAUSTION, proof)
    write_json(target / VERDICT, to_plain(decision.figures()))


@dataclass(frozen=True, slots=True)
class _Kind:
    """A kind of derived files.

    Attributes:
        lacks: Returns True if a fold lacks them.
        write: Writes those of a fold into a directory.
        files: Their names.
    """

    lacks: Callable[[FilePath], bool]
    write: Callable[[FilePath, FilePath], None]
    files: tuple[str, ...]


_KINDS: Final[Mapping[Derived, _Kind]] = {
    "figures": _Kind(lacks_derived_files, _write_figures, DERIVED_FILES),
    "verdict": _Kind(lacks_verdict, write_verdict, VERDICT_FILES),
}
