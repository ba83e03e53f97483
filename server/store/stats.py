"""Stats: cached counts of all rows, for operators."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from operator import attrgetter
from typing import Final

import sqlalchemy as sa
from cachetools import TTLCache, cachedmethod
from sqlalchemy.orm import Session

from foldback.server.settings import Settings
from foldback.server.store.leases import Leases
from foldback.server.store.schema import ENDED, STATUSES, FoldRow, MovieRow, engine_of

COUNTS_CACHE_S: Final = 2.0
"""Time for which the counts for operators (numbers of folds, durations) are cached, in s."""
RECENT_WINDOW_S: Final = 3600.0
"""Time since its end for which a fold counts in the durations that operators see, in s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ServiceCounts:
    """Counts at one moment.

    Attributes:
        folds: Number of folds by status, of all ``STATUSES``.
        movies: Number of movies by status.
        oldest_queued_s: Age of the fold that waits longest, in s; 0 if none waits.
        storage_bytes: Size of the files of all folds, with derived ones.
        workers: Number of live workers.
        computed_s: Computing time in s of each fold that ended recently, in ascending order.
        failures: Number of failed ones among these, by the code of the error.
    """

    folds: Mapping[str, int]
    movies: Mapping[str, int]
    oldest_queued_s: float
    storage_bytes: int
    workers: int
    computed_s: tuple[float, ...]
    failures: Mapping[str, int]


class Stats:
    """Counts for operators, cached for ``COUNTS_CACHE_S``.

    It has its own connection, so that it works while requests occupy all others.

    Args:
        settings: Contain the address of the database.
        leases: Leases of the workers.
    """

    def __init__(self, settings: Settings, leases: Leases) -> None:
        self._leases = leases
        self._engine = engine_of(settings)
        self._counted = threading.Condition()
        self._counts: TTLCache[tuple[()], ServiceCounts] = TTLCache(1, COUNTS_CACHE_S)
        self._bytes: TTLCache[tuple[()], int] = TTLCache(1, 60.0)  # it reads the sizes of all folds

    def close(self) -> None:
        """Close the connection."""
        self._engine.dispose()

    @cachedmethod(attrgetter("_counts"), condition=attrgetter("_counted"))
    def counts(self) -> ServiceCounts:
        """Return the counts, at most ``COUNTS_CACHE_S`` old.

        Raises:
            SQLAlchemyError: If the database does not answer.
        """
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
            ended = session.execute(
                sa.select(took, FoldRow.status, FoldRow.error)
                .where(
                    FoldRow.status.in_(ENDED),
                    # no fold is assumed to take longer than a day
                    FoldRow.created_at > now - RECENT_WINDOW_S - 86400.0,
                    FoldRow.started_at.is_not(None),
                    FoldRow.ended_at > now - RECENT_WINDOW_S,
                )
                .order_by(FoldRow.ended_at.desc())
                .limit(500)
            ).all()
            durations_s = self._taken(session)
        return ServiceCounts(
            folds=dict.fromkeys(STATUSES, 0) | {status: count for status, count in folds},
            movies={status: count for status, count in movies},
            oldest_queued_s=0.0 if oldest is None else max(0.0, now - oldest),
            storage_bytes=durations_s,
            workers=len(self._leases.workers()),
            computed_s=tuple(sorted(float(seconds or 0.0) for seconds, _, _ in ended)),
            failures=Counter(
                str((error or {}).get("code", "unknown"))
                for _, status, error in ended
                if status == "failed"
            ),
        )

    @cachedmethod(attrgetter("_bytes"), lambda *_: ())
    def _taken(self, session: Session) -> int:
        folds = sa.select(sa.func.sum(FoldRow.bytes + FoldRow.derived_bytes))
        movies = sa.select(sa.func.sum(MovieRow.bytes))
        return sum(int(session.scalar(query) or 0) for query in (folds, movies))
