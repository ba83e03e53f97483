"""Progress of jobs: rate-limited reports to the database, which also detect cancellations."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

from sqlalchemy.exc import SQLAlchemyError

from foldback.planner.progress import STAGES
from foldback.server.store.schema import passes

REPEATED_STAGES: Final = STAGES[1:4]
"""Stages of a fold that run again if several plans are computed and the best one is chosen."""
REPORT_INTERVAL_S: Final = 0.2
"""Minimum time between two reports of a running fold's progress to the database, in s; a
cancellation by the visitor is noticed as often."""


class JobProgress:
    """Progress of a job, written to its row at a bounded rate.

    Args:
        report: Writes the fields (None if they have not changed); returns False if the job is no
            longer wanted.
        fields: Fields at the start of the job.
    """

    def __init__(
        self, report: Callable[[dict[str, Any] | None], bool], fields: dict[str, Any]
    ) -> None:
        self._report = report
        self._fields = fields
        self._changed = True
        self._going = True
        self._at = 0.0

    def take(self, event: dict[str, Any]) -> None:
        """Update the fields that an event contains; its other entries are ignored."""
        self._fields = {key: event.get(key, value) for key, value in self._fields.items()}
        self._changed = True

    def cancelled(self) -> bool:
        """Return True if the job is cancelled, as of the last report."""
        if time.monotonic() - self._at >= REPORT_INTERVAL_S:
            try:
                self.last()
            except SQLAlchemyError as error:
                if not passes(error):
                    raise
                self._at = time.monotonic()  # the job continues without the database
        return not self._going

    def last(self) -> bool:
        """Report at once; return False if the job is no longer wanted."""
        self._going = self._report(self._fields if self._changed else None)
        self._changed = False
        self._at = time.monotonic()
        return self._going
