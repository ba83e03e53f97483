"""Artifacts: derived files of folds, computed once on first request, a few at a time."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Final, TypeVar

from foldback.planner.storage.files import written_aside
from foldback.server.errors import not_stored
from foldback.server.limits.disk_space import check_space
from foldback.server.limits.single_flight import SingleFlight
from foldback.server.store.fold_files import EXPORTS_DIR
from foldback.server.store.folds import NoSuchFoldError, Store

FILES_AT_ONCE: Final = 2
"""Number of derived files (exports, JSON of motions) that are computed at the same time; others
wait."""
MAX_PENDING_FILES: Final = 8
"""Maximum number of derived files (exports, JSON of motions) that are being computed or wait for
it; further requests are refused."""
Thing = TypeVar("Thing")


class Artifacts:
    """Derived files of folds, computed on first request. Belongs to one event loop.

    Attributes:
        flight: Pending computations and their limits.

    Args:
        store: Store of the folds; None if one fold in a directory is shown.
        min_free_disk_bytes: Minimum of free disk space, bytes.
        total: Maximum number of files that are computed or wait for it.
        per_visitor: Maximum number of these for one visitor.
        folder: Directory for the files; a subdirectory of their fold's directory if None.
    """

    def __init__(
        self,
        store: Store | None,
        *,
        min_free_disk_bytes: int = 0,
        folder: Path | None = None,
        total: int = MAX_PENDING_FILES,
        per_visitor: int = MAX_PENDING_FILES,
    ) -> None:
        self._store = store
        self._min_free_disk_bytes = min_free_disk_bytes
        self._folder = folder
        self.flight = SingleFlight(
            "files", at_once=FILES_AT_ONCE, total=total, per_visitor=per_visitor
        )

    def close(self) -> None:
        """Start no further computation."""
        self.flight.close()

    async def file(
        self,
        fold_id: str,
        directory: Path,
        name: str,
        make: Callable[[], bytes],
        *,
        of: str,
        edition: str = "",
        visitor: str | None = None,
    ) -> Path:
        """Return the path of a derived file; compute it unless it is up to date.

        Args:
            fold_id: Id of the fold.
            directory: Directory with the fold's files.
            name: Name of the file.
            make: Returns its bytes; called in a thread.
            of: The fold's file that it is derived from; if that is newer, it is computed again.
            edition: Letters and digits that stand for its other inputs; only the latest is kept.
            visitor: Visitor that requests it.

        Raises:
            NoSuchFoldError: If there is no such fold.
            ServiceError: If too many wait, or the disk is full.
        """
        plain = (self._folder or directory / EXPORTS_DIR) / name
        path = plain.with_stem(f"{plain.stem}-{edition}") if edition else plain

        def keep() -> None:
            data = make()
            before = _size(path)
            self._keep(fold_id, directory, path, data)
            if edition:
                for sibling in plain.parent.glob(f"{plain.stem}-*{plain.suffix}"):
                    if sibling != path:
                        before += _size(sibling)
                        sibling.unlink(missing_ok=True)
            if self._store is not None:
                self._store.add_derived(fold_id, len(data) - before)

        if not await asyncio.to_thread(newer, path, directory / of):
            await self.flight.get_or_make(path, keep, visitor=visitor)
        return path

    def _keep(self, fold_id: str, directory: Path, path: Path, data: bytes) -> None:
        try:
            place = path.parent if self._folder else directory
            check_space(place, self._min_free_disk_bytes, needed=len(data))
            path.parent.mkdir(exist_ok=True)
            # After a power cut, an empty file would count as complete.
            with written_aside(path, durable=True) as partial_path:
                partial_path.write_bytes(data)
        except FileNotFoundError as error:  # the fold was deleted in the meantime
            raise NoSuchFoldError(fold_id) from error
        except OSError as error:
            raise not_stored("file", error) from error
        try:
            if self._store is not None:
                self._store.fold(fold_id)
        except NoSuchFoldError:  # deleted just now; no file of it may remain
            shutil.rmtree(directory, ignore_errors=True)
            raise


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def newer(path: Path, than: Path) -> bool:
    """Return True if a file exists and was written after the other one."""
    try:
        return path.stat().st_mtime_ns >= than.stat().st_mtime_ns
    except OSError:
        return False
