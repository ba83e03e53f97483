"""Tasks of operators on folds, and their view of them."""

from __future__ import annotations

import contextlib
import shutil
import time
from collections.abc import Generator, Sequence
from typing import Any, Final

import sqlalchemy as sa
from dbos import DBOSClient
from sqlalchemy.orm import Session

from planner.file_names import DESCRIBED
from planner.verification.integrity import damaged_among
from server.api.base_folds import COPIED_NAMES
from server.jobs.queue import ACTIVE_JOB_STATES, APPLICATION, Jobs
from server.processes.scratch import Scratch
from server.settings import Settings
from server.store.fold_files import size_of
from server.store.folds import NoSuchFoldError, Store
from server.store.schema_version import Schema
from server.store.tables import ENDED, FoldRow, MovieRow, WorkerRow, engine_of

DAY_S: Final = 86400.0
INPUT_FILES: Final = ("input", "request.json", "cells.json", *COPIED_NAMES)
"""Files of a fold that exist before anything is computed. They stay when the operator has the fold
computed again; all its other files are deleted."""


class AdminError(Exception):
    """Something that is not done, with the reason and what to do."""


class AdminTasks:
    """Rows, files and jobs of folds, by the hand of an operator.

    Args:
        settings: Those of the service. Its tables are never changed here: they have to be there.

    Raises:
        UpkeepError: When the tables are not those of this version.
        SQLAlchemyError: When the database does not answer.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        name = settings.root / "foldback.db"
        if settings.database_url is None and not name.exists():
            raise AdminError(
                f"got no database at {name}; start the service once, or give another data "
                "directory."
            )
        engine = engine_of(settings)
        try:
            with engine.connect() as connection:
                schema = Schema.of(connection)
        finally:
            engine.dispose()
        if schema.found != schema.head:
            raise AdminError(
                f"got tables of version {schema.found}, expected {schema.head}; start this version "
                "of the service once, or use the version that wrote them."
            )
        self._store = Store(settings)

    def close(self) -> None:
        """Close the database."""
        self._store.close()

    # Looking

    def folds(
        self, *, status: str | None = None, older_days: float | None = None
    ) -> Sequence[FoldRow]:
        """Folds, the oldest first.

        Args:
            status: Only those with this status.
            older_days: Only those asked for, and looked at last, longer ago than so.
        """
        query = sa.select(FoldRow).order_by(FoldRow.created_at)
        if status is not None:
            query = query.where(FoldRow.status == status)
        if older_days is not None:
            used = sa.func.coalesce(FoldRow.seen_at, FoldRow.created_at)
            before = time.time() - older_days * DAY_S
            query = query.where(used < before, FoldRow.created_at < before)
        with self._store.reading() as session:
            return session.scalars(query).all()

    def damaged(self) -> Generator[tuple[FoldRow, list[str]]]:
        """Yield each fold that is over and has damaged files, with their names."""
        for row in self.folds():
            if row.over and (names := damaged_among(self._store.directory(row.id), DESCRIBED)):
                yield row, names

    def fold(self, fold_id: str) -> FoldRow:
        """Return the row of a fold.

        Raises:
            NoSuchFoldError: When there is none.
        """
        return self._store.fold(fold_id)

    def workers(self) -> Sequence[WorkerRow]:
        """Who computes. One that has just died is among them for the length of a lease."""
        with self._store.reading() as session:
            return session.scalars(sa.select(WorkerRow).order_by(WorkerRow.name)).all()

    def job(self, fold_id: str) -> str | None:
        """Return the state of a fold's job in the job system; None without a job."""
        with self._client() as client:
            found = client.list_workflows(workflow_ids=[fold_id], load_input=False)
        return found[0].status if found else None

    # Changing

    def pin(self, fold_id: str, *, pinned: bool) -> None:
        """Pin a fold, so that it does not expire, or unpin it.

        Raises:
            NoSuchFoldError: When there is none.
        """
        self._change(fold_id, pinned=pinned)

    def expire(self, fold_id: str, *, force: bool = False) -> None:
        """Forget a fold: its row, its job and its files. One that is computed is stopped.

        Raises:
            NoSuchFoldError: When there is none.
            UpkeepError: When it is pinned or of the gallery, and not ``force``.
        """
        row = self.fold(fold_id)
        if (row.pinned or row.public) and not force:
            what = "is pinned" if row.pinned else "belongs to the gallery"
            raise AdminError(
                f"{fold_id} {what} and is not deleted; use --force to delete it anyway."
            )
        self._store.delete(fold_id)
        # A job that runs sees that its row is gone and comes to its own end.
        if row.status not in ENDED and self.job(fold_id) in ("ENQUEUED", "DELAYED"):
            with self._client() as client:
                client.cancel_workflow(fold_id)
        self._store.folders.remove(fold_id)

    def requeue(self, fold_id: str, *, force: bool = False) -> None:
        """Queue a fold that failed, was cancelled or hangs again, from the beginning.

        It keeps its id, links and owner. Its job does too: the old one is deleted with all the
        results of its steps, for else a new one would only repeat what came out before. The epoch
        rises, so that whoever may still hold the fold has no say any more. A content key that was
        given up stays so: the same upload may meanwhile be another fold.

        Args:
            fold_id: The fold.
            force: Also when it is verified.

        Raises:
            NoSuchFoldError: When there is none.
            UpkeepError: When there is no reason to, or its input is not there any more.
        """
        row = self.fold(fold_id)
        if row.status == "verified" and not force:
            raise AdminError(f"{fold_id} is verified; use --force to compute it again anyway.")
        job = self.job(fold_id)
        if job in ACTIVE_JOB_STATES:
            what = "waits in the queue" if row.status == "queued" else "is being computed"
            raise AdminError(f"{fold_id} {what} (its job is {job}); wait for it, or expire it.")
        self._check_inputs(row)
        # Whoever may still hold it loses it first; after a crash it is one to be queued again.
        # It ends just now, so that nobody takes it for one whose files may go.
        self._change(
            fold_id,
            status="cancelled",
            ended_at=time.time(),
            worker=None,
            epoch=FoldRow.epoch + 1,
        )
        if row.status == "cancelled" and not self.fold(fold_id).bytes:
            raise _no_input(fold_id)  # a janitor has just given its files up
        self._check_inputs(row)
        size = self._strip(row)
        if job is not None:
            with self._client() as client:
                client.delete_workflow(fold_id)
        # After a crash between the two the service puts it into the queue when it starts.
        with self._store.changing() as session:
            session.execute(sa.delete(MovieRow).where(MovieRow.fold_id == fold_id))
            self._set(
                session,
                fold_id,
                status="queued",
                stage=None,
                started_at=None,
                resumed_at=None,
                ended_at=None,
                cancel_requested=False,
                pauses=0,
                progress={},
                summary={},
                error=sa.null(),
                kept=0,
                bytes=size,
                derived_bytes=0,
            )
        jobs = Jobs(self._settings)
        try:
            jobs.enqueue(fold_id, row.turn, row.cost_s)
        finally:
            jobs.close()

    def _check_inputs(self, row: FoldRow) -> None:
        shown = self._store.folders.shown(row)
        if not (shown / "input").exists() or not (shown / "request.json").exists():
            raise _no_input(row.id)

    def _strip(self, row: FoldRow) -> int:
        """Remove a fold's computed files; return the size of the others."""
        shown = self._store.folders.shown(row)
        if self._store.folders.storage is None:
            for path in shown.iterdir():
                if path.is_dir():
                    shutil.rmtree(path, ignore_errors=True)
                elif path.name not in INPUT_FILES:
                    path.unlink(missing_ok=True)
            return size_of(shown)
        with Scratch(self._settings.scratch_dir).directory() as aside:
            for name in INPUT_FILES:
                if (shown / name).exists():
                    shutil.copy2(shown / name, aside / name)
            size = size_of(aside)
            self._store.folders.adopt(aside, row.id)
            return size

    def _change(self, fold_id: str, **values: Any) -> None:
        with self._store.changing() as session:
            self._set(session, fold_id, **values)

    @staticmethod
    def _set(session: Session, fold_id: str, **values: Any) -> None:
        if session.get(FoldRow, fold_id) is None:
            raise NoSuchFoldError(fold_id)
        session.execute(sa.update(FoldRow).where(FoldRow.id == fold_id).values(**values))

    @contextlib.contextmanager
    def _client(self) -> Generator[DBOSClient]:
        client = DBOSClient(
            system_database_url=self._settings.queue_url, application_name=APPLICATION
        )
        try:
            yield client
        finally:
            client.destroy()


def _no_input(fold_id: str) -> AdminError:
    return AdminError(
        f"{fold_id} has no input file any more, because it was cancelled a while ago; expire it "
        "and fold the file again."
    )
