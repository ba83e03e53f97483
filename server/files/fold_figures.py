"""Figures, moments and verdicts of finished folds, computed when a page first asks for them."""

from __future__ import annotations

import asyncio
import logging
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

from foldback.planner.errors import UNREADABLE, PlannerError
from foldback.planner.pipeline.fold_layout import Derived, lacks_derived_files, lacks_verdict
from foldback.planner.storage.file_names import (
    CERTIFICATE,
    CHAIN,
    FORCES,
    PLAN,
    PLAYBACK,
    REQUEST,
    TIMELINE,
)
from foldback.planner.verification.integrity import check
from foldback.server.limits.disk_space import check_space
from foldback.server.limits.single_flight import SingleFlight
from foldback.server.processes.children import ChildError, Children
from foldback.server.settings import Settings
from foldback.server.store.fold_source import LocatedFold
from foldback.server.store.folds import NoSuchFoldError, Store
from foldback.words.fold import RUNNING_STATUSES

MAX_PENDING_FIGURES: Final = 8
"""Maximum number of folds whose figures are being computed or wait for it, in a viewer of one
directory; further requests are refused."""
MAX_FAILURES: Final = 1024
"""Maximum number of folds whose figures could not be computed that are remembered, so that not each
request tries again."""
SOURCES: Final = (REQUEST, TIMELINE, PLAYBACK, CERTIFICATE, FORCES, PLAN)
"""Files from which figures and moments are computed."""
log = logging.getLogger("foldback.figures")


class FoldFigures:
    """Files derived from finished folds: figures and moments, or a verdict. Of one event loop.

    Args:
        compute: Computes those of a fold, and returns the directory that they are in.
        lacks: Returns True if the fold in a directory lacks them.
        total: Maximum number of folds for which they are computed or wait for it.
        per_visitor: Maximum number of these for one visitor.
    """

    def __init__(
        self,
        compute: Callable[[LocatedFold], Path],
        *,
        lacks: Callable[[Path], bool] = lacks_derived_files,
        total: int = MAX_PENDING_FIGURES,
        per_visitor: int = MAX_PENDING_FIGURES,
    ) -> None:
        self._compute = compute
        self._lacks_files = lacks
        self._flight = SingleFlight("plots", at_once=1, total=total, per_visitor=per_visitor)
        self._elsewhere: dict[Path, Path] = {}
        self._failed: set[Path] = set()

    def close(self) -> None:
        """Start no further computation."""
        self._flight.close()

    async def of(self, located: LocatedFold, visitor: str | None = None) -> LocatedFold:
        """Return a fold with its derived files; they are computed if they are missing.

        A fold that is running, whose files are damaged, or whose derived files cannot be computed,
        is returned without them.

        Args:
            located: The fold.
            visitor: Visitor that requests it.

        Raises:
            ServiceError: If too many wait, or the disk is full.
        """
        directory = located.directory
        if directory not in self._elsewhere:
            if not await asyncio.to_thread(self._lacks, located):
                return located
            await self._flight.get_or_make(
                directory, lambda: self._computed(located), visitor=visitor
            )
        return replace(located, derived=self._elsewhere.get(directory))

    def _lacks(self, located: LocatedFold) -> bool:
        if (
            located.row.status in RUNNING_STATUSES
            or located.alternative_to is not None
            or located.directory in self._failed
        ):
            return False
        try:
            return self._lacks_files(located.directory)
        except (PlannerError, *UNREADABLE):  # reported where the files are read
            return False

    def _computed(self, located: LocatedFold) -> None:
        directory = located.directory
        # An earlier computation may have ended after this request had looked for its files.
        if directory in self._elsewhere or not self._lacks(located):
            return
        try:
            if (place := self._compute(located)) != directory:
                self._elsewhere[directory] = place
        except (ChildError, PlannerError, *UNREADABLE) as error:
            log.warning("directory=%s figures failed: %s", directory, error)
            if len(self._failed) >= MAX_FAILURES:
                self._failed.clear()
            self._failed.add(directory)


def figures_by(
    children: Children, settings: Settings, store: Store, derived: Derived = "figures"
) -> FoldFigures:
    """Return the derived files of a service, which a child computes in the folder of its fold."""
    lacks, sources = (
        (lacks_derived_files, SOURCES) if derived == "figures" else (lacks_verdict, (CHAIN,))
    )

    def compute(located: LocatedFold) -> Path:
        directory = located.directory
        if settings.read_only:
            return directory
        check_space(directory, settings.min_free_disk_bytes)
        check(directory, *sources)
        child = children.take()
        try:
            child.call(derived, directory, wall_s=settings.stage_seconds)
        finally:
            children.release(child)
        try:
            store.fold(located.row.id)
        except NoSuchFoldError:  # deleted just now; no file of it may remain
            shutil.rmtree(directory, ignore_errors=True)
        return directory

    return FoldFigures(
        compute,
        lacks=lacks,
        total=settings.files_waiting,
        per_visitor=settings.files_waiting_of_visitor,
    )
