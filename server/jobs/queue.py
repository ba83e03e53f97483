"""Queue: folds and movies that workers claim, checkpoint and return.

The rows of the database are the queue. A fold that is not over and has no ``worker`` waits; the
smallest ``turn`` is next. A single statement assigns it to one execution, so that no two workers
get the same fold.
An execution has a unique name and writes to the row only while ``worker`` is this name, so an
execution that has lost its fold writes nothing.

A fold continues after its last finished stage: ``checkpoint`` contains the next stage and the epoch
of the files that this stage starts from.
"""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

import sqlalchemy as sa
from sqlalchemy.orm import Session

from foldback.planner.progress import STAGES
from foldback.server.store.folds import Store, in_lane, rows_of
from foldback.server.store.schema import ENDED, FoldRow, MovieRow
from foldback.words.fold import RUNNING_STATUSES

MAX_LOSSES: Final = 100
"""Number of times that a fold or a movie may be lost with its worker (a crash or a restart of the
machine) without a finished stage in between; then it fails."""


class Lane(StrEnum):
    """Part of the queue; each worker has separate slots for each lane."""

    LONG = "long"
    QUICK = "quick"
    MOVIES = "movies"


@dataclass(frozen=True, slots=True)
class FoldClaim:
    """Fold that is assigned to an execution.

    Attributes:
        fold_id: The fold.
        execution: Name of the execution.
        stage: The next stage.
        files: Epoch of the files that this stage starts from.
        losses: Number of executions since the last finished stage whose worker died.
    """

    fold_id: str
    execution: str
    stage: str
    files: int
    losses: int


@dataclass(frozen=True, slots=True)
class MovieClaim:
    """Movie that is assigned to an execution.

    Attributes:
        fold_id: Its fold.
        movie_id: Key of its options.
        job: Name of its file and row, unique among all movies.
        execution: Name of the execution.
        losses: Number of executions whose worker died.
    """

    fold_id: str
    movie_id: str
    job: str
    execution: str
    losses: int = 0


Claim = FoldClaim | MovieClaim


class Queue:
    """Workers' access to the queue. Safe for use by several threads.

    Args:
        store: Rows of the folds and movies.
    """

    def __init__(self, store: Store) -> None:
        self._store = store

    def has_work(self) -> bool:
        """Return True if a job waits; a single query, suitable for polling."""
        return bool(self._store.scalar(_HAS_WORK))

    def claim(self, lane: Lane, worker: str) -> Claim | None:
        """Claim the next job of a lane for a worker; return None if none waits."""
        execution = f"{worker}:{secrets.token_hex(6)}"
        waits = _waiting(lane)
        claim = self._claim_movie if lane is Lane.MOVIES else self._claim_fold
        while True:
            with self._store.changing() as session:
                row = session.execute(waits).first()
                if row is None:
                    return None
                if (claimed := claim(session, row, execution)) is not None:
                    return claimed
            # Another worker was faster, or the job has just been cancelled.

    def _claim_fold(self, session: Session, row: sa.Row[Any], execution: str) -> FoldClaim | None:
        checkpoint = row.checkpoint or {"stage": STAGES[0], "files": 0}
        stage, files = str(checkpoint["stage"]), int(checkpoint["files"])
        if self._store.begin_in(session, row.id, stage, execution) is None:
            return None
        return FoldClaim(row.id, execution, stage, files, row.losses)

    @staticmethod
    def _claim_movie(session: Session, row: sa.Row[Any], execution: str) -> MovieClaim | None:
        claim_update = sa.update(MovieRow).where(MovieRow.job == row.job, _MOVIE_WAITS)
        claimed = session.execute(claim_update.values(status="running", worker=execution))
        if not rows_of(claimed):
            return None
        return MovieClaim(row.fold_id, row.id, row.job, execution, row.losses)

    def keep(self, claim: FoldClaim, *, stage: str, files: int) -> bool:
        """Store that a fold continues with ``stage``, from the files of epoch ``files``.

        Returns:
            False if another execution has the fold, or it was deleted.
        """
        kept_query = (
            sa.update(FoldRow)
            .where(*_held_by(claim))
            .values(checkpoint={"stage": stage, "files": files}, losses=0)
        )
        return bool(self._store.change(kept_query))

    def hand_back(self, claim: Claim) -> None:
        """Put an unfinished job back into the queue."""
        if isinstance(claim, FoldClaim):
            self._store.change(_FOLD_BACK.where(*_held_by(claim)))
        else:
            self._store.change(_MOVIE_BACK.where(MovieRow.worker == claim.execution))

    def release(self, claim: FoldClaim) -> None:
        """Clear the worker of a fold that has ended."""
        self._store.change(sa.update(FoldRow).where(*_held_by(claim)).values(worker=None))

    def holders(self) -> set[str]:
        """Return the names of the workers that have jobs."""
        rows = [
            *self._store.scalars(sa.select(FoldRow.worker).where(FoldRow.worker.is_not(None))),
            *self._store.scalars(sa.select(MovieRow.worker).where(MovieRow.status == "running")),
        ]
        return {name.rpartition(":")[0] for name in rows if name}

    def hand_back_all(self, worker: str, *, lost: bool) -> list[tuple[str, int]]:
        """Put all jobs of a worker back into the queue.

        Args:
            worker: Name of the worker.
            lost: True if the worker died; False if it stops regularly.

        Returns:
            Folds that it has ended but not released, each with the epoch of the files that stay.
        """
        new_losses = int(lost)
        is_theirs = FoldRow.worker.startswith(f"{worker}:", autoescape=True)
        with self._store.changing() as session:
            session.execute(_FOLD_BACK.where(is_theirs).values(losses=FoldRow.losses + new_losses))
            session.execute(
                _MOVIE_BACK.where(MovieRow.worker.startswith(f"{worker}:", autoescape=True)).values(
                    losses=MovieRow.losses + new_losses
                )
            )
            release = (
                sa.update(FoldRow).where(is_theirs, FoldRow.status.in_(ENDED)).values(worker=None)
            )
            ended = session.execute(release.returning(FoldRow.id, FoldRow.kept)).all()
        return [(row.id, row.kept) for row in ended]


def _waiting(lane: Lane) -> sa.Executable:
    """Return the query for the next job of a lane."""
    if lane is Lane.MOVIES:
        waiting = (
            sa.select(MovieRow.fold_id, MovieRow.id, MovieRow.job, MovieRow.losses)
            .where(_MOVIE_WAITS)
            .order_by(MovieRow.created_at)
        )
    else:
        waiting = (
            sa.select(FoldRow.id, FoldRow.checkpoint, FoldRow.losses)
            .where(*_FOLD_WAITS, in_lane(quick=lane is Lane.QUICK))
            .order_by(FoldRow.turn, FoldRow.created_at)
        )
    return waiting.limit(1).with_for_update(skip_locked=True)  # in SQLite writers take turns


def _held_by(claim: FoldClaim) -> tuple[sa.ColumnElement[bool], ...]:
    """Return the conditions for an execution to still hold its fold."""
    return (FoldRow.id == claim.fold_id, FoldRow.worker == claim.execution)


_FOLD_WAITS: Final = (
    FoldRow.status.in_(RUNNING_STATUSES),
    FoldRow.worker.is_(None),
    FoldRow.cancel_requested.is_(False),
)
_MOVIE_WAITS: Final = MovieRow.status == "queued"
_HAS_WORK: Final = sa.select(
    sa.or_(
        sa.select(FoldRow.id).where(*_FOLD_WAITS).exists(),
        sa.select(MovieRow.job).where(_MOVIE_WAITS).exists(),
    )
)
_FOLD_BACK: Final = (
    sa.update(FoldRow)
    .where(FoldRow.status == "running")
    .values(
        status=sa.case((FoldRow.cancel_requested, "cancelled"), else_=FoldRow.status),
        # The time of the cancellation, which counts as an access.
        ended_at=sa.case((FoldRow.cancel_requested, FoldRow.seen_at)),
        worker=None,
    )
)
"""Statement that puts running folds back into the queue; cancelled ones end. The others are still
displayed as ``running``: they continue before all folds with a later turn."""
_MOVIE_BACK: Final = (
    sa.update(MovieRow).where(MovieRow.status == "running").values(status="queued", worker=None)
)
"""Statement that puts running movies back into the queue."""
