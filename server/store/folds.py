"""Store: rows of all folds, and access to their directories.

Each change that several processes may make at the same time is a single statement that finds and
changes the row. A request for a fold that is just being cancelled thus either joins it, and it
continues, or creates another fold.
"""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar, TypeVarTuple

import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError, SQLAlchemyError
from sqlalchemy.orm import Session, sessionmaker

from foldback.planner.pipeline.expected_cost import ExpectedCost, expected_cost
from foldback.server.limits.fair_queue import (
    QUICK_FOLD_S,
    is_quick,
    network_of,
    slice_s,
    ticks,
    virtual_finish_time,
)
from foldback.server.limits.queue_room import Waiting
from foldback.server.settings import Settings
from foldback.server.store.fold_files import Folders, NoSuchFoldError
from foldback.server.store.fold_source import LocatedFold
from foldback.server.store.owner import Owner, owned_by
from foldback.server.store.schema import (
    ENDED,
    Base,
    CounterRow,
    FoldRow,
    SecretRow,
    TourRow,
    ValuesRow,
    changing_alone,
    engine_of,
    is_read_only,
    migrate,
    request_of,
)
from foldback.server.store.staged_files import discard_staged, finish_restore, staged_numbers
from foldback.words.fold import RUNNING_STATUSES, ShownFold

__all__ = ["FoldRow", "NoSuchFoldError", "Store", "new_id", "rows_of"]

Kind = TypeVar("Kind", bound=Base)
Value = TypeVar("Value")
Values = TypeVarTuple("Values")
TURN_COUNTER: Final = sa.update(CounterRow).where(CounterRow.name == "turn")
DAY_S: Final = 86400.0
"""Number of seconds in a day."""


def new_id() -> str:
    """Return an id that cannot be guessed: 100 random bits in letters and digits."""
    alphabet = "abcdefghijkmnpqrstuvwxyz23456789"
    return "".join(secrets.choice(alphabet) for _ in range(20))


class Ahead(NamedTuple):
    """Work before a queued fold in its lane.

    Attributes:
        place: Position in the queue, from 1.
        ahead_s: Expected seconds of the folds before it, at the recently measured speed.
        running_s: Remaining seconds of the running folds, at most until their slices are over.
        running: Number of running folds.
    """

    place: int
    ahead_s: float
    running_s: float
    running: int


class Store:
    """Rows and files of folds. Safe for use by several threads.

    Attributes:
        folders: Files of the folds.
    """

    def __init__(self, settings: Settings) -> None:
        self.folders = Folders(settings)
        self._settings = settings
        self._keep_days = settings.keep_days
        self._first_slice_s = settings.slice_seconds
        self.admitting = threading.Lock()
        """Lock that is held from the check of the queue until a fold is in it."""
        self._engine = engine_of(settings)
        migrate(self._engine)
        finish_restore(self._engine, settings, self.folders.storage)
        self.reading = sessionmaker(self._engine, expire_on_commit=False)
        """Factory of sessions that read."""
        self.changing = self.reading.begin
        """Factory of sessions that commit their changes together, or none of them."""

    def discard_staged(self) -> None:
        """Delete what interrupted restores have left.

        Raises:
            StorageError: If the storage does not answer.
        """
        if set(staged_numbers(self._settings, self.folders.storage)):
            with changing_alone(self._engine) as connection:
                discard_staged(connection, self._settings, self.folders.storage)

    def close(self) -> None:
        """Close all connections."""
        self._engine.dispose()
        self.folders.close()

    def directory(self, fold_id: str) -> Path:
        """Return the directory with a fold's files for readers.

        Raises:
            NoSuchFoldError: If this is not an id or, with an object store, there is no such fold.
            StorageError: If the storage does not answer.
        """
        place = self.folders.place(fold_id)
        return place if self.folders.storage is None else self.folders.shown(self.fold(fold_id))

    def get(self, kind: type[Kind], key: str | tuple[str, str]) -> Kind | None:
        """Return the row of a primary key; None if there is none."""
        with self.reading() as session:
            return session.get(kind, key)

    def scalar(self, query: sa.Select[Value]) -> Value | None:
        """Return the first column of the first row of a query; None without rows."""
        with self.reading() as session:
            return session.scalar(query)

    def scalars(self, query: sa.Select[Value]) -> Sequence[Value]:
        """Return the first column of all rows of a query."""
        with self.reading() as session:
            return session.scalars(query).all()

    def rows(self, query: sa.Select[*Values]) -> Sequence[sa.Row[*Values]]:
        """Return all rows of a query."""
        with self.reading() as session:
            return session.execute(query).all()

    def change(self, statement: sa.Update | sa.Delete) -> int:
        """Execute a statement; return the number of rows that it has changed."""
        with self.changing() as session:
            return rows_of(session.execute(statement))

    # Reading

    def fold(self, fold_id: str) -> FoldRow:
        """Return the row of a fold.

        Raises:
            NoSuchFoldError: If there is none.
        """
        row = self.get(FoldRow, fold_id)
        if row is None:
            raise NoSuchFoldError(fold_id)
        return row

    def find(self, fold_id: str) -> LocatedFold | None:
        """Return a fold by its id, and record the access; None if there is none."""
        try:
            row = self.fold(fold_id)
        except NoSuchFoldError:
            return None
        self.looked(row)
        recorded = None
        if row.smooths is not None:
            with suppress(NoSuchFoldError):
                recorded = self.fold(row.smooths).id
        return LocatedFold(ShownFold.of(row), self.folders.shown(row), recorded)

    def tour(self, fold_id: str) -> dict[str, Any] | None:
        """Return the tour that a fold's owner has stored, as plain values; None if none."""
        return self._told(TourRow, fold_id)

    def values(self, fold_id: str) -> dict[str, Any] | None:
        """Return the module values that a fold's owner has stored; None if there are none."""
        return self._told(ValuesRow, fold_id)

    def _told(self, kind: type[TourRow | ValuesRow], fold_id: str) -> dict[str, Any] | None:
        row = self.get(kind, fold_id)
        return None if row is None else row.content

    def list_public(self, limit: int = 100) -> Sequence[FoldRow]:
        """Return the gallery folds that are not cancelled, newest first."""
        return self._newest(limit, FoldRow.public, FoldRow.cancel_requested.is_(False))

    def list_owned(self, owner: Owner, limit: int = 100) -> Sequence[FoldRow]:
        """Return the folds of an owner, newest first."""
        return self._newest(limit, owned_by(owner))

    def _newest(
        self, limit: int, *conditions: sa.ColumnExpressionArgument[bool]
    ) -> Sequence[FoldRow]:
        newest_first = sa.select(FoldRow).where(*conditions).order_by(FoldRow.created_at.desc())
        return self.scalars(newest_first.limit(limit))

    def kept_until(self, row: FoldRow) -> float | None:
        """Return when a fold expires without further access; None if it does not expire."""
        if self._keep_days is None or row.pinned or row.public or not row.over:
            return None
        return row.seen_at + self._keep_days * DAY_S

    def owns(self, fold_id: str, owner: Owner) -> bool:
        """Return True if a fold belongs to an owner; gallery folds belong to none."""
        row = self.get(FoldRow, fold_id)
        return row is not None and not row.public and owner.owns(row.owner)

    def waiting(self) -> list[Waiting]:
        """Return the visitor and the expected cost of each fold that is queued or running."""
        query = sa.select(FoldRow.visitor, FoldRow.cost_s).where(
            FoldRow.status.in_(RUNNING_STATUSES)
        )
        return [Waiting(*row) for row in self.rows(query)]

    def others_wait(self, fold_id: str, *, spent_s: float, cheaper: bool) -> bool:
        """Return True if another fold waits whose turn is before the next one of a running fold.

        Args:
            fold_id: The running fold.
            spent_s: Seconds that it has computed.
            cheaper: True to count only folds with a smaller expected cost.
        """
        with self.reading() as session:
            cost_s = session.scalar(sa.select(FoldRow.cost_s).where(FoldRow.id == fold_id)) or 0.0
            now = session.scalar(sa.select(CounterRow.value).where(CounterRow.name == "turn")) or 0
            queued = sa.select(FoldRow.id).where(
                FoldRow.status == "queued",
                FoldRow.id != fold_id,
                FoldRow.turn < now + ticks(max(cost_s, spent_s)),
                in_lane(quick=is_quick(cost_s)),
            )
            if cheaper:
                queued = queued.where(FoldRow.cost_s < cost_s)
            return session.scalar(queued.limit(1)) is not None

    def slices_s(self, fold_id: str) -> tuple[float, float]:
        """Return the seconds until a fold is paused for cheaper ones, and for any.

        If the fold was deleted, they are those of a fold without cost.
        """
        query = sa.select(FoldRow.cost_s, FoldRow.pauses).where(FoldRow.id == fold_id)
        cost_s, pauses = next(iter(self.rows(query)), (0.0, 0))
        first_s = self._first_slice_s
        return slice_s(cost_s, pauses, first_s, for_cheaper=True), slice_s(cost_s, pauses, first_s)

    def ahead(self, row: FoldRow) -> Ahead:
        """Return the work before a queued fold in its lane."""
        before = sa.or_(
            FoldRow.turn < row.turn,
            sa.and_(FoldRow.turn == row.turn, FoldRow.created_at < row.created_at),
        )
        queued = sa.select(
            sa.func.count(), sa.func.coalesce(sa.func.sum(FoldRow.cost_s), 0.0)
        ).where(FoldRow.status == "queued", before, in_lane(quick=is_quick(row.cost_s)))
        running = sa.select(FoldRow.cost_s, FoldRow.pauses, FoldRow.resumed_at).where(
            FoldRow.status == "running", in_lane(quick=is_quick(row.cost_s))
        )
        now = time.time()
        with self.reading() as session:
            count, ahead_s = session.execute(queued).one()
            factor = self._duration_factor(session)
            left_s = 0.0
            computed = session.execute(running).all()
            for cost_s, pauses, since in computed:
                spent_s = now - (since or now)
                cheaper = row.cost_s < cost_s
                room_s = slice_s(cost_s, pauses, self._first_slice_s, for_cheaper=cheaper) - spent_s
                expected_s = max(0.2 * factor * cost_s, factor * cost_s - spent_s)
                # the check of the queue, and the end of a step
                left_s += min(expected_s, max(1.0, room_s))
        return Ahead(
            place=count + 1,
            ahead_s=factor * float(ahead_s),
            running_s=left_s,
            running=len(computed),
        )

    @staticmethod
    def _duration_factor(session: Session) -> float:
        """Return the actual time of recent folds divided by the expected time; 1 if unknown."""
        recent_folds = (
            sa.select(FoldRow.ended_at - FoldRow.started_at, FoldRow.cost_s)
            .where(FoldRow.status == "verified", FoldRow.cost_s > 0, FoldRow.pauses == 0)
            .order_by(FoldRow.created_at.desc())
            .limit(40)
        )
        taken_s = cost = 0.0
        for took, expected in session.execute(recent_folds):
            if took is not None and took >= 0:
                taken_s, cost = taken_s + took, cost + expected
        return taken_s / cost if taken_s and cost else 1.0

    def add(self, row: FoldRow, owner: Owner) -> bool:
        """Add a fold with its owner; return False if another fold has its content key.

        This determines its turn in the queue.
        """
        row.owner = row.maker = owner.digest
        row.cost_s = cost_of(row).expected_s
        try:
            with self.changing() as session:
                row.turn = self._turn(session, row)
                session.add(row)
        except IntegrityError:
            used_key = sa.select(FoldRow.id).where(FoldRow.content_key == row.content_key)
            if row.content_key is None or self.scalar(used_key) is None:
                raise
            return False
        return True

    @staticmethod
    def _turn(session: Session, row: FoldRow) -> int:
        waiting = session.execute(
            sa.select(FoldRow.visitor, FoldRow.turn).where(FoldRow.status.in_(RUNNING_STATUSES))
        ).all()
        if not waiting:
            session.execute(TURN_COUNTER.values(value=0))  # virtual time starts again
        now = session.scalar(sa.select(CounterRow.value).where(CounterRow.name == "turn")) or 0
        network = network_of(row.visitor)
        sharers = {visitor for visitor, _ in waiting if network_of(visitor) == network}
        first = bool(row.public)
        if first:
            # Repeatedly cancelled gallery folds of a visitor lose their priority.
            first = not session.scalar(
                sa.select(sa.func.count()).where(
                    FoldRow.public,
                    FoldRow.visitor == row.visitor,
                    FoldRow.status == "cancelled",
                    FoldRow.created_at > row.created_at - 3600.0,  # for an hour
                )
            )
        return virtual_finish_time(
            now=now,
            last_own=max(
                (turn for waiting_visitor, turn in waiting if waiting_visitor == row.visitor),
                default=None,
            ),
            cost_s=row.cost_s,
            sharers=len(sharers | {row.visitor}),
            first=first,
        )

    def secret(self, name: str, new_secret: bytes) -> bytes:
        """Return a secret of the service; store ``new_secret`` if there is none yet."""
        stored = self.get(SecretRow, name)
        if stored is None:
            try:
                if is_read_only(self._engine):
                    return new_secret
                with self.changing() as session:
                    session.add(SecretRow(name=name, value=new_secret))
                return new_secret
            except IntegrityError:  # another process was faster
                return self.secret(name, new_secret)
        return stored.value

    def looked(self, row: FoldRow) -> None:
        """Record an access to a fold, at a coarse resolution; errors are ignored."""
        now = time.time()
        if abs(now - row.seen_at) > 900.0:
            with suppress(SQLAlchemyError):
                self._change(row.id, seen_at=now)

    def ask(self, content_key: str, owner: Owner) -> FoldRow | None:
        """Join the existing fold with a content key; return None if there is none.

        A gallery fold that another owner requests loses its owner, so that neither can cancel it
        for the other. This counts as an access.
        """
        shared = sa.and_(FoldRow.public, sa.not_(owned_by(owner)))
        query = (
            sa.update(FoldRow)
            .where(FoldRow.content_key == content_key)
            .values(owner=sa.case((shared, None), else_=FoldRow.owner), seen_at=time.time())
            .returning(FoldRow)
            .execution_options(synchronize_session=False)
        )
        with self.changing() as session:
            return session.scalar(query)

    def cancel(self, fold_id: str, owner: Owner) -> bool:
        """Cancel an unfinished fold; a running one stops as soon as its worker sees this.

        Returns:
            False if the fold does not belong to the owner.
        """
        is_own = (FoldRow.id == fold_id, owned_by(owner))
        waits = FoldRow.worker.is_(None)
        with self.changing() as session:
            session.execute(
                sa.update(FoldRow)
                .where(*is_own, FoldRow.status.in_(RUNNING_STATUSES))
                .values(
                    status=sa.case((waits, "cancelled"), else_=FoldRow.status),
                    ended_at=sa.case((waits, time.time()), else_=FoldRow.ended_at),
                    seen_at=time.time(),
                    content_key=None,
                    cancel_requested=True,
                )
            )
            return session.scalar(sa.select(FoldRow.id).where(*is_own)) is not None

    def expire(self, fold_id: str, seen_at: float | None) -> bool:
        """Delete a fold that is unpinned, has ended and has not been accessed since ``seen_at``."""
        deletion = sa.delete(FoldRow).where(
            FoldRow.id == fold_id,
            FoldRow.pinned.is_(False),
            FoldRow.status.in_(ENDED),
            FoldRow.seen_at == seen_at,
        )
        return bool(self.change(deletion))

    def delete(self, fold_id: str, owner: Owner | None = None) -> bool:
        """Delete a fold's row; the caller removes its directory.

        Args:
            fold_id: The fold.
            owner: Delete only a fold of this owner, and no gallery fold; any fold if None.

        Returns:
            True if it was deleted.
        """
        deletion = sa.delete(FoldRow).where(FoldRow.id == fold_id)
        if owner is not None:
            deletion = deletion.where(owned_by(owner), FoldRow.public.is_(False))
        return bool(self.change(deletion))

    def add_derived(self, fold_id: str, size: int) -> None:
        """Add to the size of a fold's derived files; those in a cache do not count."""
        if self.folders.storage is None:
            self._change(fold_id, derived_bytes=FoldRow.derived_bytes + size)

    def set_derived(self, fold_id: str, size: int) -> None:
        """Store the size of a fold's derived files."""
        self._change(fold_id, derived_bytes=size)

    # Writing by workers

    def begin(self, fold_id: str, stage: str, execution: str) -> int | None:
        """Mark a stage as running; claim the fold if no execution has it.

        Args:
            fold_id: The fold.
            stage: Stage that starts.
            execution: Name of the execution.

        Returns:
            Epoch of the execution; None if the fold is cancelled, over, deleted, or computed by
            another execution.
        """
        with self.changing() as session:
            return self.begin_in(session, fold_id, stage, execution)

    @staticmethod
    def begin_in(session: Session, fold_id: str, stage: str, execution: str) -> int | None:
        """Mark a stage as running, as ``begin`` does, in a transaction of the caller."""
        is_same_worker = FoldRow.worker == execution
        first_start = session.execute(
            sa.update(FoldRow)
            .where(
                FoldRow.id == fold_id,
                FoldRow.status.in_(RUNNING_STATUSES),
                FoldRow.cancel_requested.is_(False),
                sa.or_(is_same_worker, FoldRow.worker.is_(None)),
            )
            .values(
                status="running",
                stage=stage,
                started_at=sa.func.coalesce(FoldRow.started_at, time.time()),
                epoch=sa.case((is_same_worker, FoldRow.epoch), else_=FoldRow.epoch + 1),
                resumed_at=sa.case((is_same_worker, FoldRow.resumed_at), else_=time.time()),
                worker=execution,
            )
            .returning(FoldRow.epoch, FoldRow.turn)
        ).first()
        if first_start is None:
            return None
        session.execute(
            TURN_COUNTER.where(CounterRow.value < first_start[1]).values(value=first_start[1])
        )
        return first_start[0]

    def pause(self, fold_id: str, epoch: int, *, spent_s: float) -> bool:
        """Put a running fold back into the queue, with the turn of a fold that is requested now.

        Args:
            fold_id: The fold.
            epoch: Epoch in which it runs.
            spent_s: Seconds that it has computed, a lower bound of its cost.

        Returns:
            False if the fold is cancelled, over, deleted, or computed by another execution.
        """
        is_ours = (
            FoldRow.id == fold_id,
            FoldRow.epoch == epoch,
            FoldRow.status == "running",
            FoldRow.cancel_requested.is_(False),
        )
        with self.changing() as session:
            row = session.scalar(sa.select(FoldRow).where(*is_ours))
            if row is None:
                return False
            row.cost_s = max(row.cost_s, spent_s)
            row.turn = self._turn(session, row)
            row.pauses += 1
            row.status = "queued"
            row.worker = None
            return True

    def show(self, fold_id: str, epoch: int) -> None:
        """Publish the files of an epoch to readers, unless a later one owns the fold."""
        self.change(
            sa.update(FoldRow)
            .where(FoldRow.id == fold_id, FoldRow.epoch == epoch)
            .values(kept=epoch)
        )

    def describe(
        self,
        fold_id: str,
        *,
        name: str,
        modules: int,
        module: str,
        module_words: dict[str, str] | None,
    ) -> None:
        """Store the facts of a fold's chain; a name from the gallery or the owner stays."""
        unnamed = sa.and_(FoldRow.shape.is_(None), FoldRow.renamed.is_(False))
        shown_name = sa.case((unnamed, name[:200]), else_=FoldRow.name)
        self._change(
            fold_id, modules=modules, module=module, module_words=module_words, name=shown_name
        )

    def stage_s(self, fold_id: str) -> dict[str, float]:
        """Return the seconds of each stage of a fold so far; empty if it was deleted."""
        with suppress(NoSuchFoldError):
            return dict(self.fold(fold_id).progress.get("stage_s", {}))
        return {}

    def report(self, fold_id: str, epoch: int, progress: dict[str, Any] | None = None) -> bool:
        """Store changed progress; return False if the execution must stop."""
        going = (
            FoldRow.id == fold_id,
            FoldRow.epoch == epoch,
            FoldRow.cancel_requested.is_(False),
        )
        if progress is None:
            return self.scalar(sa.select(FoldRow.id).where(*going)) is not None
        return bool(self.change(sa.update(FoldRow).where(*going).values(progress=progress)))

    def finish(
        self,
        fold_id: str,
        status: str,
        *,
        summary: dict[str, Any],
        error: dict[str, Any] | None = None,
        repeatable: bool = True,
        kept_epoch: int | None = None,
        size: int | None = None,
        execution: str | None = None,
    ) -> bool:
        """End a fold, once; return False if it was deleted. A cancelled one stays cancelled.

        Args:
            fold_id: The fold.
            status: One of ``ENDED``.
            summary: Figures of the result.
            error: ``code``, ``detail`` and ``where`` of the error, or None.
            repeatable: True if the same upload would have the same result. If False, the next one
                is computed again.
            kept_epoch: Epoch whose files readers see from now on; unchanged if None.
            size: Total size of its files, bytes; unchanged if None.
            execution: Name of the execution that must have the fold; any if None.
        """
        values: dict[str, Any] = {
            "status": status,
            "ended_at": time.time(),
            "summary": summary,
            "error": error,
            "seen_at": time.time(),
        }
        if size is not None:
            values["bytes"] = size
        if kept_epoch is not None:
            values["kept"] = kept_epoch
        if not repeatable:
            values["content_key"] = None
        going = sa.update(FoldRow).where(FoldRow.id == fold_id, FoldRow.status.not_in(ENDED))
        if execution is not None:
            going = going.where(FoldRow.worker == execution)
        with self.changing() as session:
            if status != "cancelled":
                not_cancelled = FoldRow.cancel_requested.is_(False)
                session.execute(going.where(not_cancelled).values(**values))
                values |= {"status": "cancelled", "summary": {}, "error": None}
            session.execute(going.values(**values))
            return session.get(FoldRow, fold_id) is not None

    def _change(self, fold_id: str, **values: Any) -> None:
        self.change(sa.update(FoldRow).where(FoldRow.id == fold_id).values(**values))


def cost_of(row: FoldRow, modules: int | None = None) -> ExpectedCost:
    """Return the expected cost of a fold, or of a similar one with ``modules`` modules."""
    return expected_cost(row.modules if modules is None else modules, request_of(row))


def in_lane(*, quick: bool) -> sa.ColumnElement[bool]:
    """Return the condition for a fold to be in the lane for quick folds, or in the other one."""
    return FoldRow.cost_s <= QUICK_FOLD_S if quick else FoldRow.cost_s > QUICK_FOLD_S


def rows_of(result: sa.Result[Any]) -> int:
    """Return the number of rows that a statement has changed."""
    return result.rowcount if isinstance(result, sa.CursorResult) else 0
