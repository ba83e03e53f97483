"""Exports: files made of a finished fold when they are first asked for, a few at once."""

from __future__ import annotations

import asyncio
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Final

from planner.errors import InputError
from planner.files import write_whole
from server.problems import Problem, no_such_fold
from server.store import NoSuchFoldError, Store

if TYPE_CHECKING:
    from planner.exports import Export

MOST_AT_ONCE: Final = 2
FOLDER: Final = "exports"


class Exports:
    """Makes exports, each once, and keeps them beside the fold. Belongs to one event loop.

    Args:
        store: Where the folds are.
        min_free_disk_bytes: What must be left of the disk.
    """

    def __init__(self, store: Store, *, min_free_disk_bytes: int) -> None:
        self._store = store
        self._min_free_disk_bytes = min_free_disk_bytes
        self._making: dict[Path, asyncio.Task[None]] = {}

    async def file(self, fold_id: str, export: Export) -> Path:
        """Where the export of a fold that is over is; made unless it is there.

        Raises:
            NoSuchFoldError: When this is not an id.
            Problem: When the plan has no such export (404), too many are being made (503), or the
                disk is full (507).
        """
        directory = self._store.directory(fold_id)
        kept = directory / export.filename
        if await asyncio.to_thread(kept.is_file):
            return kept  # the fold's own stages have written it
        path = directory / FOLDER / export.filename
        if not await asyncio.to_thread(_newer, path, directory / "plan.npz"):
            await self._made(fold_id, export, path)
        return path

    async def _made(self, fold_id: str, export: Export, path: Path) -> None:
        task = self._making.get(path)
        if task is None:
            if len(self._making) >= MOST_AT_ONCE:
                raise Problem(
                    503,
                    "busy",
                    f"{len(self._making)} other files are being made; try again in a moment.",
                    headers={"Retry-After": "2"},
                )
            task = asyncio.create_task(asyncio.to_thread(self._make, fold_id, export, path))
            self._making[path] = task

            def done(task: asyncio.Task[None]) -> None:
                del self._making[path]
                if not task.cancelled():
                    task.exception()  # whoever waited was told; nobody may be left

            task.add_done_callback(done)
        # Who goes away does not take the file from the others that wait for it.
        await asyncio.shield(task)

    def _make(self, fold_id: str, export: Export, path: Path) -> None:
        # It brings the physics along, which the start of the server need not wait for.
        from planner.plan import Plan

        directory = path.parent.parent
        try:
            data = export.write(Plan.load(directory / "plan.npz"))
        except InputError as error:
            raise Problem(404, "no-such-artifact", error.detail, where=error.where) from error
        try:
            if shutil.disk_usage(directory).free < self._min_free_disk_bytes + len(data):
                raise Problem(507, "no-room", "The disk of the service is nearly full; try later.")
            path.parent.mkdir(exist_ok=True)
            write_whole(path, data)
        except FileNotFoundError as error:  # the fold was deleted in the meantime
            raise no_such_fold() from error
        except OSError as error:
            raise Problem(
                507, "no-room", f"The file could not be stored ({error.strerror}); try later."
            ) from error
        try:
            self._store.fold(fold_id)
        except NoSuchFoldError:  # just now; nothing of it may be left
            shutil.rmtree(directory, ignore_errors=True)
            raise


def _newer(path: Path, than: Path) -> bool:
    """Whether a file is there and was made after the other."""
    try:
        return path.stat().st_mtime_ns >= than.stat().st_mtime_ns
    except OSError:
        return False
