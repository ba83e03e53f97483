"""Stats: a few sums over all rows, for operators; asked for rarely, answered from memory else."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import sqlalchemy as sa
from sqlalchemy.orm import Session

from server.settings import Settings
from server.store.leases import Leases
from server.store.tables import ENDED, STATUSES, FoldRow, MovieRow, engine_of

KEPT_S: Final = 2.0
SUM_KEPT_S: Final = 60.0
"""Seconds that the one figure is cached for which all rows have to be read."""
RECENT_WINDOW_S: Final = 3600.0
LONGEST_S: Final = 86400.0
"""Seconds from asking for a fold to its end, at most: bounds the search for those that ended."""
MOST_ENDED: Final = 500


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """What was counted at one moment.

    Attributes:
        folds: Number of folds by status, of all ``STATUSES``.
        movies: Number of movies by status.
        oldest_queued_s: Age of the fold that waits for longest; 0 when none does.
        storage_bytes: What the files of all folds take, with what was made of them.
        workers: Workers that live.
        computed_s: How long each of the folds took that ended lately, the least first.
    """

    folds: Mapping[str, int]
    movies: Mapping[str, int]
    oldest_queued_s: float
    storage_bytes: int
    workers: int
    computed_s: tuple[float, ...]


class Stats:
    """Counts, at most every ``KEPT_S``.

    It has a connection of its own: when a crowd holds all others, operators want to see it.

    Args:
        settings: Say where the rows are.
        leases: Knows the workers.
    """

    def __init__(self, settings: Settings, leases: Leases) -> None:
        self._leases = leases
        self._engine = engine_of(settings)
        self._lock = threading.Lock()
        self._kept: tuple[float, Figures] | None = None
        self._bytes: tuple[float, int] | None = None

    def close(self) -> None:
        """Lets go of the connection."""
        self._engine.dispose()

    def figures(self) -> Figures:
        """The figures, at most ``KEPT_S`` old.

        Raises:
            SQLAlchemyError: When the database does not answer.
        """
        with self._lock:
            now = time.monotonic()
            if self._kept is None or now - self._kept[0] >= KEPT_S:
                self._kept = (now, self._count())
            return self._kept[1]

    def workers(self) -> int:
        """Workers that live.

        Raises:
            SQLAlchemyError: When the database does not answer.
        """
        return len(self._leases.workers())

    def _count(self) -> Figures:
        now = time.time()
        took = FoldRow.ended_at - FoldRow.started_at
        with Session(self._engine) as session:
            folds = session.execute(
                sa.select(FoldRow.status, sa.func.count()).group_by(FoldRow.status)
            ).all()
            oldest = session.scalar(
                sa.select(sa.func.min(FoldRow.created_at)).where(FoldRow.status == "queued")
            )
            movies = session.execute(
                sa.select(MovieRow.status, sa.func.count()).group_by(MovieRow.status)
            ).all()
            ended = session.scalars(
                sa.select(took)
                .where(
                    FoldRow.status.in_(ENDED),
                    FoldRow.created_at > now - RECENT_WINDOW_S - LONGEST_S,
                    FoldRow.started_at.is_not(None),
                    FoldRow.ended_at > now - RECENT_WINDOW_S,
                )
                .order_by(FoldRow.ended_at.desc())
                .limit(MOST_ENDED)
            ).all()
            taken = self._taken(session)
        return Figures(
            folds=dict.fromkeys(STATUSES, 0) | {status: count for status, count in folds},
            movies={status: count for status, count in movies},
            oldest_queued_s=0.0 if oldest is None else max(0.0, now - oldest),
            storage_bytes=taken,
            workers=self.workers(),
            computed_s=tuple(sorted(float(seconds or 0.0) for seconds in ended)),
        )

    def _taken(self, session: Session) -> int:
        now = time.monotonic()
        if self._bytes is None or now - self._bytes[0] >= SUM_KEPT_S:
            folds = sa.select(sa.func.sum(FoldRow.bytes + FoldRow.derived_bytes))
            movies = sa.select(sa.func.sum(MovieRow.bytes))
            self._bytes = (now, sum(int(session.scalar(each) or 0) for each in (folds, movies)))
        return self._bytes[1]
