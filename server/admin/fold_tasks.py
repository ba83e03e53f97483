"""Tasks of operators on folds: lists, deletion, repetition, and protection from expiry."""

from __future__ import annotations

import shutil
import time
from collections.abc import Generator, Sequence
from typing import Any, Final

import sqlalchemy as sa

from foldback.planner.storage.file_names import DESCRIBED
from foldback.planner.verification.integrity import damaged_among
from foldback.server.admin.errors import AdminError
from foldback.server.admin.migration import schema_of
from foldback.server.processes.scratch import Scratch
from foldback.server.settings import Settings
from foldback.server.store.fold_files import size_of
from foldback.server.store.folds import DAY_S, NoSuchFoldError, Store
from foldback.server.store.leases import Leases
from foldback.server.store.schema import ENDED, FoldRow, MovieRow, WorkerRow, missing_database
from foldback.server.submission.parent_folds import COPIED_NAMES

INPUT_FILES: Final = ("input", "request.json", "cells.json", *COPIED_NAMES)
"""Files of a fold that exist before its computation. They stay if an operator lets the fold be
computed again; all its other files are deleted."""


class AdminTasks:
    """Access of an operator to the rows and files of folds.

    Args:
        settings: Settings of the service. Its database must have a schema; it is not migrated.

    Raises:
        AdminError: If there is no database, or its schema is not that of this version.
        SQLAlchemyError: If the database does not answer.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        if missing := missing_database(settings.store_url):
            raise AdminError(
                f"got no database at {missing}; start the service once, or give another data "
                "directory."
            )
        schema = schema_of(settings)
        if schema.missing:
            raise AdminError(
                f"got a database of version {schema.version}, expected {schema.head}; run "
                "`foldback admin migrate`, or use the foldback version that wrote it."
            )
        self._store = Store(settings)

    def close(self) -> None:
        """Close the database."""
        self._store.close()

    def folds(
        self, *, status: str | None = None, older_days: float | None = None
    ) -> Sequence[FoldRow]:
        """Return folds, oldest first.

        Args:
            status: Status of the folds; None for all.
            older_days: Minimum time since the request and since the last access, in days.
        """
        query = sa.select(FoldRow).order_by(FoldRow.created_at)
        if status is not None:
            query = query.where(FoldRow.status == status)
        if older_days is not None:
            before = time.time() - older_days * DAY_S
            query = query.where(FoldRow.seen_at < before, FoldRow.created_at < before)
        return self._store.scalars(query)

    def damaged(self) -> Generator[tuple[FoldRow, list[str]]]:
        """Yield each ended fold with damaged files, and the names of these."""
        for row in self.folds():
            if row.over and (names := damaged_among(self._store.directory(row.id), DESCRIBED)):
                yield row, names

    def fold(self, fold_id: str) -> FoldRow:
        """Return the row of a fold.

        Raises:
            NoSuchFoldError: If there is no such fold.
        """
        return self._store.fold(fold_id)

    def workers(self) -> Sequence[WorkerRow]:
        """Return the live workers."""
        return Leases(self._settings, self._store).workers()

    def pin(self, fold_id: str, *, pinned: bool) -> None:
        """Pin a fold, so that it does not expire, or unpin it.

        Raises:
            NoSuchFoldError: If there is no such fold.
        """
        self._change(fold_id, pinned=pinned)

    def expire(self, fold_id: str, *, force: bool = False) -> None:
        """Delete the row and the files of a fold. Its computation ends when it finds no row.

        Raises:
            NoSuchFoldError: If there is no such fold.
            AdminError: If it is pinned or of the gallery, and ``force`` is False.
        """
        row = self.fold(fold_id)
        if (row.pinned or row.public) and not force:
            reason = "is pinned" if row.pinned else "belongs to the gallery"
            raise AdminError(
                f"{fold_id} {reason}, so it is not deleted; use --force to delete it anyway."
            )
        self._store.delete(fold_id)
        self._store.folders.remove(fold_id)

    def requeue(self, fold_id: str, *, force: bool = False) -> None:
        """Queue an ended fold again, to compute it from the beginning.

        Its id, links and owner stay, but its checkpoint is deleted. The epoch increases, so that a
        worker that still computes the fold can no longer change it. A removed content key is not
        restored, because another fold may have it.

        Args:
            fold_id: The fold.
            force: True to repeat verified folds as well.

        Raises:
            NoSuchFoldError: If there is no such fold.
            AdminError: If the fold needs no repetition, or its input is missing.
        """
        row = self.fold(fold_id)
        if row.status == "verified" and not force:
            raise AdminError(f"{fold_id} is verified; use --force to compute it again anyway.")
        if row.status not in ENDED:
            state = "waits in the queue" if row.status == "queued" else "is being computed"
            raise AdminError(f"{fold_id} {state}; wait until it ends, or delete it with `expire`.")
        self._check_inputs(row)
        # First take the fold from a worker that may still compute it. If this process crashes now,
        # the fold can be queued again. It ends now, so that no sweep deletes its files as those of
        # an old cancelled fold.
        self._change(
            fold_id,
            status="cancelled",
            ended_at=time.time(),
            worker=None,
            epoch=FoldRow.epoch + 1,
        )
        if row.status == "cancelled" and not self.fold(fold_id).bytes:
            raise _no_input(fold_id)  # a sweep has just deleted its files
        self._check_inputs(row)
        size = self._strip(row)
        self._store.change(sa.delete(MovieRow).where(MovieRow.fold_id == fold_id))
        self._change(
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
            checkpoint=sa.null(),
            losses=0,
        )

    def _check_inputs(self, row: FoldRow) -> None:
        reader_dir = self._store.folders.shown(row)
        if not (reader_dir / "input").exists() or not (reader_dir / "request.json").exists():
            raise _no_input(row.id)

    def _strip(self, row: FoldRow) -> int:
        """Remove a fold's computed files; return the size of the others."""
        reader_dir = self._store.folders.shown(row)
        if self._store.folders.storage is None:
            for path in reader_dir.iterdir():
                if path.is_dir():
                    shutil.rmtree(path, ignore_errors=True)
                elif path.name not in INPUT_FILES:
                    path.unlink(missing_ok=True)
            return size_of(reader_dir)
        with Scratch(self._settings.scratch_dir).directory() as directory:
            for name in INPUT_FILES:
                if (reader_dir / name).exists():
                    shutil.copy2(reader_dir / name, directory / name)
            size = size_of(directory)
            self._store.folders.adopt(directory, row.id)
            return size

    def _change(self, fold_id: str, **values: Any) -> None:
        changed = sa.update(FoldRow).where(FoldRow.id == fold_id).values(**values)
        if not self._store.change(changed):
            raise NoSuchFoldError(fold_id)


def _no_input(fold_id: str) -> AdminError:
    return AdminError(
        f"{fold_id} has no input file any more; the file was deleted some time after the fold was "
        "cancelled. Delete the fold with `expire`, and upload the input again."
    )
