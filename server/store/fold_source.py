"""Fold source: folds as pages find them, in a service or in a directory."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from words.fold import ShownFold


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

    def find(self, fold_id: str, /) -> Found | None:
        """Return a fold by its id, and record the access; None if there is none."""
        ...

    def tour(self, fold_id: str, /) -> dict[str, Any] | None:
        """Return the tour that is stored with a fold, as plain values; None without one."""
        ...

    def values(self, fold_id: str, /) -> dict[str, Any] | None:
        """Return the numbers stored with a fold, as plain values; None without any."""
        ...


def id_of_fold(shown_id: str) -> str:
    """Return the id of the fold to which the id of a page belongs: ``abc`` for ``abc-3``."""
    return shown_id.partition("-")[0]
