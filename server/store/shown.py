"""A fold as pages show it, from a service or from a directory."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Final, Protocol

from planner.certificate.figures import Fault, FoldSummary
from planner.chain.module import CUBE
from planner.parameters.parameters import AUTO, FLOATING
from planner.pipeline.preference import COMPUTING
from server.store.tables import FoldRow

RUNNING_STATUSES: Final = ("queued", "running")
"""Statuses of folds that wait or are being computed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownFold:
    """Facts of a fold for pages; ``server.store.tables.FoldRow`` explains the values."""

    id: str
    name: str
    status: str
    modules: int
    preset: str
    seed: int
    stage: str | None = None
    module: str = CUBE.name
    public: bool = False
    pinned: bool = False
    settings: str = ""
    module_size: float | None = None
    strategy: str = AUTO
    prefer: str = COMPUTING
    world: str = FLOATING
    refold: str | None = None
    smooths: str | None = None
    summary: FoldSummary = field(default_factory=FoldSummary)
    error: Fault | None = None
    renamed: bool = False

    @property
    def called(self) -> str:
        """Name for people, or the owner's name for it."""
        return self.name if self.renamed else shown_name(self.name)

    @property
    def title(self) -> str:
        """Name on pages: of both shapes for a refold, unless the owner has renamed it."""
        if self.renamed:
            return self.name
        name = shown_name(self.name) or "New fold"
        if self.smooths:
            return f"{name}, smoothed"
        return f"{shown_name(self.refold)} → {name}" if self.refold else name

    @classmethod
    def of(cls, row: FoldRow) -> ShownFold:
        """Return the facts in a row of the database."""
        return cls(**{each.name: getattr(row, each.name) for each in fields(cls)})


@dataclass(frozen=True, slots=True)
class Found:
    """A fold, and the directory of its files.

    Attributes:
        row: Facts of the fold.
        directory: Directory with its files.
        recorded: Id of the fold whose plan was smoothed, while it exists.
        alternative_to: Id of the fold of which this is another plan; None for a fold.
    """

    row: ShownFold
    directory: Path
    recorded: str | None = None
    alternative_to: str | None = None


class FoldSource(Protocol):
    """Source of folds for pages."""

    def find(self, fold_id: str) -> Found | None:
        """Return a fold by its id, and record the access; None if there is none."""
        ...


def shown_name(name: str) -> str:
    """Return a name for people: ``wrench-160`` is a wrench, its size stands beside it."""
    if (sized := re.fullmatch(r"([a-z]+)-(\d+)", name)) is not None:
        return sized[1].capitalize()
    if (box := re.fullmatch(r"([a-z]+)-(\d+)x(\d+)x(\d+)", name)) is not None:
        return f"{box[1].capitalize()} {box[2]}×{box[3]}×{box[4]}"
    return name


def id_of_fold(shown_id: str) -> str:
    """Return the id of the fold to which the id of a page belongs: ``abc`` for ``abc-3``."""
    return shown_id.partition("-")[0]


def has_motion(summary: Mapping[str, object] | None) -> bool:
    """Return True if a plan of this summary has frames."""
    return bool((summary or {}).get("playback"))
