"""Previews: shapes before they are folded, stored for a day or while there is room.

A directory holds one upload; under it lies a directory for each set of options, with what they were
(``request.json``) and what came of them (``report.json``).
"""

from __future__ import annotations

import json
import logging
import os
import re
import shutil
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO, Final

from planner.chain.module import CUBE
from planner.errors import InputError
from planner.file_names import PREPARED
from planner.pipeline.request import PreviewRequest
from server.errors import (
    NoSuch,
    ServiceError,
    TooMany,
    TooSlow,
    Unavailable,
    Unusable,
    not_stored,
)
from server.files.stored_previews import (
    UPLOAD_FILE,
    HeldPreview,
    StoredPreviews,
    noted,
    superfluous,
    visitor_noted,
)
from server.files.uploads import Upload
from server.limits.disk_space import check_space
from server.processes.children import ChildError, Reader
from server.settings import Settings
from server.store.folds import new_id
from server.store.object_store import Storage, StorageError

OPTIONS_KEY: Final = re.compile(r"[0-9a-f]{24}")
MAX_OPTION_SETS: Final = 400
"""Maximum number of sets of options for which previews of one upload are stored. The uploader and
all other visitors together each have this number; further sets are refused. A larger value lets one
upload occupy more of the disk. Chosen."""
OFFERS_FILE: Final = "offers.json"
"""Name of the file, in the directory of a preview, with the variants of the shape that can fold on
a table."""
REMOVED_PREFIX: Final = ".going-"
"""Prefix that a directory's name gets before its files are deleted, so that no reader finds it;
after a crash a sweep deletes directories with this prefix."""
PREVIEW_SETTLED_S: Final = 300.0
"""Time since the last change of a preview's directory after which its size is not measured again,
in s. It exceeds the time for which a preview is computed; a smaller value could miss files that are
written later. Chosen."""
STRANGER_FILE: Final = "stranger"
"""Name of the file that marks a preview as requested by a visitor other than the uploader; such
previews count separately."""
STAT_BLOCK_BYTES: Final = 512
"""Size of the blocks that ``st_blocks`` of a file's status counts, in bytes (POSIX)."""
PREVIEW_SWEEP_S: Final = 60.0
"""Time after which an upload or a preview starts the next deletion of expired previews, in s. With
a larger value expired previews occupy the disk for longer. Chosen."""
PREVIEW_SWEEP_BYTES: Final = 16 * 2**20
"""Number of newly written bytes of uploads and previews after which expired previews are deleted,
at most an eighth of the limit for all previews. With a larger value the limit is exceeded further
in between. Chosen."""
UNREAD_UPLOAD_S: Final = 60.0
"""Time for which a new upload without a preview is not deleted by a sweep, in s, as it may still be
read. A smaller value may delete uploads during reading. Chosen."""
MAX_PROTECTED_UPLOADS: Final = 4
"""Maximum number of one visitor's newest uploads that sweeps do not delete while they are being
read. With a larger value a flood of uploads could exceed the limit of the disk. Chosen."""
log = logging.getLogger("foldback.web")


class NoSuchPreviewError(NoSuch):
    """There is no preview with this id, or not any more."""

    def __init__(self, preview_id: str) -> None:
        super().__init__(
            "no-such-preview", "This preview does not exist or has expired; send the file again."
        )


class Previews:
    """Uploads under preview, on disk. Safe to use from many threads.

    Args:
        settings: The settings.
        storage: Object store shared with other web processes; None if files stay on this machine.
    """

    def __init__(self, settings: Settings, storage: Storage | None = None) -> None:
        self._settings = settings
        self._elsewhere = StoredPreviews(settings, storage)
        self._root = settings.previews_dir
        if not settings.read_only:
            self._root.mkdir(parents=True, exist_ok=True)
        self._lock = threading.Lock()
        self._swept = -PREVIEW_SWEEP_S
        self._sweeping = False
        self._coming = 0
        self._measured: dict[str, tuple[float, HeldPreview]] = {}
        self._unread: dict[str, tuple[float, str]] = {}
        """Uploads without a report: until when they are not swept (monotonic clock, s), and their
        visitors."""

    def add(self, upload: Upload, visitor: str) -> str:
        """Move a visitor's upload here; return its id, which cannot be guessed.

        Raises:
            NoRoom: When the disk has no room for it.
        """
        preview_id = new_id()
        with self._lock:
            self._unread[preview_id] = time.monotonic() + UNREAD_UPLOAD_S, visitor
        try:
            about = json.dumps({"filename": upload.filename, "visitor": visitor})
            (upload.directory / UPLOAD_FILE).write_text(about)
            os.rename(upload.directory, self._root / preview_id)
        except OSError as error:
            raise not_stored("upload", error) from error
        self._elsewhere.keep(preview_id, self._root / preview_id)
        self._sweep_soon(upload.size)
        return preview_id

    def directory(self, preview_id: str) -> Path:
        """Return the directory of an upload; ids are checked before they become a path.

        Raises:
            NoSuchPreviewError: When there is none.
            StorageError: When it would have to be brought here and the storage does not answer.
        """
        if not (preview_id.isascii() and preview_id.isalnum() and len(preview_id) <= 32):
            raise NoSuchPreviewError(preview_id)
        directory = self._root / preview_id
        fetch = self._elsewhere.fetch
        if not ((directory / UPLOAD_FILE).is_file() or fetch(preview_id, directory)):
            raise NoSuchPreviewError(preview_id)
        return directory

    def place(self, preview_id: str, key: str) -> Path:
        """Return the directory of an upload's preview with some options, if it exists.

        Raises:
            NoSuchPreviewError: When there is no such upload.
            StorageError: When it would have to be brought here and the storage does not answer.
        """
        place = self.directory(preview_id) / key
        if not (place / "report.json").is_file():
            self._elsewhere.fetch_report(place)
        return place

    def upload(self, preview_id: str) -> tuple[BinaryIO, str | None]:
        """Return the open upload and its name.

        Raises:
            NoSuchPreviewError: When there is none.
        """
        filename = self.filename(preview_id)
        try:
            return open(self.directory(preview_id) / "input", "rb"), filename
        except OSError as error:  # swept away this very moment
            raise NoSuchPreviewError(preview_id) from error

    def filename(self, preview_id: str) -> str | None:
        """Return the name of an upload.

        Raises:
            NoSuchPreviewError: When there is none, or what was noted of it is damaged.
        """
        try:
            about = noted((self.directory(preview_id) / UPLOAD_FILE).read_bytes())
        except OSError as error:
            raise NoSuchPreviewError(preview_id) from error
        if "filename" not in about or not isinstance(about["filename"], str | None):
            raise NoSuchPreviewError(preview_id)
        return about["filename"]

    def report(
        self,
        preview_id: str,
        options: PreviewRequest,
        reader: Reader,
        *,
        visitor: str,
        gone: Callable[[], bool] | None = None,
    ) -> dict[str, Any]:
        """Return the report of an upload with these options; it is computed once.

        Args:
            preview_id: The upload's.
            options: Options that turn it into a path.
            reader: Processes that compute it.
            visitor: Visitor that requests it.
            gone: Asked often whether the one who asked has gone away.

        Raises:
            NoSuchPreviewError: When there is no such upload.
            ServiceError: When it cannot be used, took too long, or too many wait.
        """
        place = self.place(preview_id, options.key)
        directory = place.parent
        with suppress(OSError):  # a read-only disk; what has been computed is shown all the same
            os.utime(directory)
        self._elsewhere.touch(directory)
        if (known := read_report(place)) is not None:
            return known
        stranger = visitor != visitor_noted((directory / UPLOAD_FILE).read_bytes())
        if _option_sets(directory, of_strangers=stranger) >= MAX_OPTION_SETS:
            raise TooMany(
                "too-many-previews",
                "Too many previews of this file; send the file again.",
                retry_after_s=60,
            )
        self._sweep_soon()  # reports may be much larger than what they tell of
        check_space(self._root, self._settings.min_free_disk_bytes)
        place.mkdir(exist_ok=True)
        if stranger:
            (place / STRANGER_FILE).touch()
        request = {"filename": self.filename(preview_id), **options.to_json()}
        request["time_limit_s"] = self._settings.preview_search_seconds
        (place / "request.json").write_text(json.dumps(request))
        try:
            reader.call("preview", place, visitor=visitor, cancelled=gone)
        except InputError as error:
            raise Unusable.of(error) from None
        except ChildError as error:
            raise _problem(error, self._settings.preview_seconds) from None
        finally:
            with self._lock:
                self._unread.pop(preview_id, None)
        found = read_report(place)
        if found is None and gone is not None and gone():
            raise Unavailable("gone", "The preview was cancelled, because its client disconnected.")
        if found is None:
            raise NoSuchPreviewError(preview_id)
        self._elsewhere.keep_report(place)
        return found

    def offers(
        self,
        preview_id: str,
        options: PreviewRequest,
        reader: Reader,
        *,
        visitor: str,
        gone: Callable[[], bool] | None = None,
    ) -> dict[str, Any]:
        """Return versions of an upload that can fold on a table; searched once.

        There are none for a world without gravity, and for a shape that has a path as it is.

        Args:
            preview_id: The upload's.
            options: The options of the preview that found no path.
            reader: The children that search.
            visitor: Visitor that requests it.
            gone: True once the client has left; the search ends then.

        Raises:
            NoSuchPreviewError: When there is no such upload.
            ServiceError: When it cannot be used, took too long, or too many wait.
        """
        report = self.report(preview_id, options, reader, visitor=visitor, gone=gone)
        if options.world != "table" or report["has_path"]:
            return {"offers": []}
        place = self.place(preview_id, options.key)
        if (known := _json_at(place / OFFERS_FILE)) is not None:
            return known
        try:
            reader.call("offers", place, visitor=visitor, cancelled=gone)
        except InputError as error:
            raise Unusable.of(error) from None
        except ChildError as error:
            if error.code != "time-limit" or not (place / OFFERS_FILE).is_file():
                raise _problem(error, self._settings.preview_seconds) from None
        found = _json_at(place / OFFERS_FILE)
        if found is None:
            raise Unavailable("gone", "The search was cancelled, because its client disconnected.")
        self._elsewhere.keep_report(place)
        return found

    def there(self, preview_id: str) -> bool:
        """Return True if an upload still exists, here or in the object store.

        Raises:
            StorageError: When the storage does not answer.
        """
        return (self._root / preview_id / UPLOAD_FILE).is_file() or self._elsewhere.there(
            preview_id
        )

    def remove(self, preview_id: str) -> None:
        """Forget an upload and all that came of it; the next sweep removes its files.

        Raises:
            StorageError: When the storage does not answer.
        """
        _set_aside(self._root / preview_id)
        self._elsewhere.remove(preview_id)
        with self._lock:
            self._swept = -PREVIEW_SWEEP_S
        self._sweep_soon()

    def cells(self, preview_id: str, options: PreviewRequest) -> list[list[int]] | None:
        """Return the cube cells of an upload with these options, if they have been computed.

        Raises:
            NoSuchPreviewError: When there is no such upload.
        """
        report = read_report(self.place(preview_id, options.key))
        return report["cells"] if report is not None and report["module"] == CUBE.name else None

    def prepared(self, preview_id: str, options: PreviewRequest) -> Path | None:
        """Return the file of the chains that came of an upload with these options, if there is one.

        Raises:
            NoSuchPreviewError: If there is no such upload.
        """
        path = self.place(preview_id, options.key) / PREPARED
        return path if path.is_file() else None

    def _sweep_soon(self, coming: int = 0) -> None:
        """Sweep in a thread of its own if that is due; no request waits for it.

        Args:
            coming: Bytes that an upload adds.
        """
        with self._lock:
            self._coming += coming
            enough = min(PREVIEW_SWEEP_BYTES, self._settings.previews_bytes // 8)
            due = time.monotonic() - self._swept >= PREVIEW_SWEEP_S or self._coming >= enough
            if not due or self._sweeping:
                return
            self._sweeping, self._coming = True, 0
        threading.Thread(target=self._sweep, name="preview-sweep", daemon=True).start()

    def _sweep(self) -> None:
        try:
            self.sweep()
            self._elsewhere.sweep_if_due()
        except (OSError, StorageError, RuntimeError) as error:  # the process may be ending
            log.warning("old previews could not be deleted: %s", error)
        finally:
            with self._lock:
                self._swept, self._sweeping = time.monotonic(), False

    def sweep(self) -> None:
        """Remove previews that are old, and the oldest of visitors with too many or too large ones.

        A preview that nobody has used since it was measured is not measured again.
        """
        measured: dict[str, tuple[float, HeldPreview]] = {}
        for entry in os.scandir(self._root):
            if entry.name.startswith(REMOVED_PREFIX):  # a removal that was cut off
                shutil.rmtree(entry.path, ignore_errors=True)
            if entry.name.startswith("."):
                continue
            known = self._measured.get(entry.name)
            found = _measure(Path(entry.path), known)
            if found is not None:
                measured[entry.name] = found
        self._measured = measured
        held = [preview for _, preview in measured.values()]
        unread = self._being_read()
        for name in superfluous(held, self._settings, now=time.time()):
            if name in unread:
                continue
            self._measured.pop(name, None)
            _remove(self._root / name)

    def _being_read(self) -> set[str]:
        """Return the uploads that are not swept, and forget those whose time is over."""
        now = time.monotonic()
        newest: dict[str, list[str]] = {}
        with self._lock:
            self._unread = {name: each for name, each in self._unread.items() if each[0] > now}
            for name, (_, visitor) in self._unread.items():  # in the order of their arrival
                newest.setdefault(visitor, []).append(name)
        return {name for names in newest.values() for name in names[-MAX_PROTECTED_UPLOADS:]}


def _option_sets(directory: Path, *, of_strangers: bool) -> int:
    """Return the number of sets of options of an upload's owner, or of all others."""
    places = [entry for entry in os.scandir(directory) if OPTIONS_KEY.fullmatch(entry.name)]
    return sum(os.path.exists(f"{each.path}/{STRANGER_FILE}") == of_strangers for each in places)


def read_report(place: Path) -> dict[str, Any] | None:
    """Return the report in a directory of options, if it exists."""
    return _json_at(place / "report.json")


def cells_of_repair(place: Path) -> list[list[int]]:
    """Return the cells that the repair among the offers in a directory of options adds."""
    offers = (_json_at(place / OFFERS_FILE) or {"offers": []})["offers"]
    return next((offer["added"] for offer in offers if offer["added"]), [])


def _json_at(path: Path) -> dict[str, Any] | None:
    """Return the JSON object in a file; None where there is none."""
    try:
        return json.loads(path.read_bytes())
    except (OSError, ValueError):
        return None


def _measure(
    directory: Path, known: tuple[float, HeldPreview] | None
) -> tuple[float, HeldPreview] | None:
    """Return the time and what a directory holds; None if it is gone.

    Args:
        directory: Directory of a preview.
        known: The result of an earlier look.
    """
    try:
        touched, now = directory.stat().st_mtime, time.time()
        if (
            known is not None
            and known[1].touched == touched
            and known[0] > touched + PREVIEW_SETTLED_S
        ):
            return known
        about = directory / UPLOAD_FILE
        own, foreign = _sizes(directory)
        return now, HeldPreview(
            name=directory.name,
            touched=touched,
            size=own,
            foreign=foreign,
            visitor=visitor_noted(about.read_bytes() if about.is_file() else None),
        )
    except OSError:
        return None


def _sizes(directory: Path) -> tuple[int, int]:
    """Return the bytes of an upload with its owner's options, and those of strangers' options."""
    strangers = {path.parent for path in directory.glob(f"*/{STRANGER_FILE}")}
    own = foreign = 0
    for path in directory.rglob("*"):
        size = path.lstat().st_blocks * STAT_BLOCK_BYTES
        if strangers & {path, path.parent}:
            foreign += size
        else:
            own += size
    return own, foreign


def _remove(directory: Path) -> None:
    """Remove a preview; readers see all of it or nothing."""
    shutil.rmtree(_set_aside(directory), ignore_errors=True)


def _set_aside(directory: Path) -> Path:
    """Give a preview a name under which no reader sees it; return that path."""
    going = directory.with_name(f"{REMOVED_PREFIX}{directory.name}-{new_id()}")
    with suppress(OSError):  # another process has removed it
        directory.rename(going)
    return going


def _problem(error: ChildError, seconds: float) -> ServiceError:
    if error.code == "time-limit":
        return TooSlow(
            "preview-too-slow",
            f"no path was found within {seconds:g} s, the time limit of a preview; use fewer "
            "modules, or the method 'blocks'.",
        )
    if error.code == "no-start":
        return Unavailable(error.code, error.detail)
    return Unusable("unreadable", f"reading the file failed: {error.detail}")
