"""A fold as people see it: its facts and its names."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Final

from foldback.planner.certificate.figures import Fault, FoldSummary
from foldback.planner.chain.built_in_modules import DEFAULT_MODULE, words_named
from foldback.planner.chain.module import ModuleWords
from foldback.planner.parameters.parameters import AUTO, FLOATING
from foldback.planner.pipeline.preference import COMPUTING
from foldback.planner.plan.rests import rest_frames

RUNNING_STATUSES: Final = ("queued", "running")
"""Statuses of folds that wait or are being computed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownFold:
    """Facts of a fold for people; ``server.store.schema.FoldRow`` explains the values."""

    id: str
    name: str
    status: str
    modules: int
    preset: str
    seed: int
    stage: str | None = None
    module: str = DEFAULT_MODULE
    module_words: dict[str, str] | None = None
    public: bool = False
    pinned: bool = False
    settings: str = ""
    module_size: float | None = None
    strategy: str = AUTO
    prefer: str = COMPUTING
    world: str = FLOATING
    refold: str | None = None
    smooths: str | None = None
    shape: str | None = None
    summary: FoldSummary = field(default_factory=FoldSummary)
    error: Fault | None = None
    renamed: bool = False
    created_at: float | None = None

    @property
    def words(self) -> ModuleWords:
        """What its modules are called."""
        return words_named(self.module, self.module_words)

    @property
    def counted(self) -> str:
        """Number of its modules with their kind, for example "160 cubes"."""
        return self.words.counted(self.modules)

    @property
    def called(self) -> str:
        """Name that the owner chose, or the name for people."""
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
    def of(cls, row: object) -> ShownFold:
        """Return the facts of a row of ``server.store.schema.FoldRow``."""
        return cls(**{field.name: getattr(row, field.name) for field in fields(cls)})


def shown_name(name: str) -> str:
    """Return a name for people: Wrench for ``wrench-160``, as pages also state the size."""
    if (sized := re.fullmatch(r"([a-z]+)-(\d+)", name)) is not None:
        return sized[1].capitalize()
    if (box := re.fullmatch(r"([a-z]+)-(\d+)x(\d+)x(\d+)", name)) is not None:
        return f"{box[1].capitalize()} {box[2]}×{box[3]}×{box[4]}"
    return name


def has_motion(summary: Mapping[str, object] | None) -> bool:
    """Return True if a plan of this summary has frames."""
    return bool((summary or {}).get("playback"))


def step_count(summary: Mapping[str, Any] | None) -> int:
    """Return the number of steps of a plan of this summary; 0 if it does not rest between steps."""
    return max(0, len(rest_frames((summary or {}).get("playback"))) - 1)
