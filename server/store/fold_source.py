"""Fold source: access of pages to folds, in a service or in a directory."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from foldback.words.fold import ShownFold


@dataclass(frozen=True, slots=True)
class LocatedFold:
    """A fold, and the directory of its files.

    Attributes:
        row: Facts of the fold.
        directory: Directory with its files.
        recorded: Id of the fold whose plan was smoothed; None if there is none or it is deleted.
        alternative_to: Id of the fold that this is an alternative plan of, or None.
        derived: Directory with its figures and moments if that is another one; None if not.
    """

    row: ShownFold
    directory: Path
    recorded: str | None = None
    alternative_to: str | None = None
    derived: Path | None = None

    @property
    def derived_dir(self) -> Path:
        """Directory with its figures and moments, which may be missing."""
        return self.derived or self.directory


class FoldSource(Protocol):
    """Source of folds for pages."""

    def find(self, fold_id: str, /) -> LocatedFold | None:
        """Return a fold by its id, and record the access; None if there is none."""
        ...

    def tour(self, fold_id: str, /) -> dict[str, Any] | None:
        """Return the tour stored with a fold, as plain values; None if there is none."""
        ...

    def values(self, fold_id: str, /) -> dict[str, Any] | None:
        """Return the module values stored with a fold, as plain values; None if there are none."""
        ...


def id_of_fold(shown_id: str) -> str:
    """Return the id of the fold that a page's id belongs to: ``abc`` for ``abc-3``."""
    return shown_id.partition("-")[0]
