"""A fold as pages show it, whether a service computes it or somebody looks at its directory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Final, Protocol

from planner.certificate.figures import Fault, FoldSummary
from planner.chain.module import CUBE
from planner.pipeline.preference import COMPUTING
from planner.simulation.parameters import AUTO
from server.store.tables import FoldRow

RUNNING: Final = ("queued", "running")
"""Statuses of folds that are not over."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownFold:
    """What pages say of a fold; ``server.store.tables.FoldRow`` tells what each value is."""

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
    refold: str | None = None
    smooths: str | None = None
    summary: FoldSummary = field(default_factory=FoldSummary)
    error: Fault | None = None

    @classmethod
    def of(cls, row: FoldRow) -> ShownFold:
        """Of what a service has noted."""
        return cls(**{each.name: getattr(row, each.name) for each in fields(cls)})


@dataclass(frozen=True, slots=True)
class Found:
    """A fold, and the directory of its files.

    Attributes:
        row: What is known of it.
        directory: Where its files are.
        recorded: Of a smoothed fold, the id of the one that was smoothed, while that is there.
    """

    row: ShownFold
    directory: Path
    recorded: str | None = None


class FoldSource(Protocol):
    """Where pages find folds."""

    def find(self, fold_id: str) -> Found | None:
        """The fold of that id, which somebody looks at now; None when there is none."""
        ...


def has_motion(summary: Mapping[str, object] | None) -> bool:
    """Whether a plan of this summary has frames."""
    return bool((summary or {}).get("playback"))
