"""Uploads: what comes in, on disk from its first bytes on, until it is accepted or forgotten.

Each process has a directory of its own under ``uploads_dir``, held by a lock for as long as the
process lives; what dead processes have left there was never acknowledged, and is swept away.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable, Coroutine, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from fcntl import LOCK_EX, LOCK_NB, flock
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, BinaryIO, Final

from fastapi import Request, Response
from fastapi.routing import APIRoute
from starlette.datastructures import FormData, Headers
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Receive, Scope, Send

from server.http.client_address import address_of
from server.http.problems import Problem
from server.http.security import SAFE_METHODS, forget
from server.http.streams import Streams
from server.settings import Settings
from server.store.folds import new_id

if TYPE_CHECKING:
    from starlette._utils import AwaitableOrContextManager

PIECE_BYTES: Final = 2**18
LOCK: Final = "lock"
FORMS: Final = ("multipart/form-data", "application/x-www-form-urlencoded")
MOST_FILES: Final = 2
MOST_FIELDS: Final = 32
LARGEST_FIELD_BYTES: Final = 16 * 1024


@dataclass(frozen=True, slots=True, kw_only=True)
class Upload:
    """Something to be read, in a directory of its own: moved into its place when it is accepted.

    Attributes:
        directory: Holds the file ``input``, which is safe on disk.
        filename: What it was called, if anything.
        digest: SHA-256 of the file.
        size: Its bytes.
    """

    directory: Path
    filename: str | None
    digest: str
    size: int


class Uploads:
    """The uploads of one process. Safe to use from many threads.

    What a form brings is spooled beside them, so that it is swept away with them.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        root = settings.uploads_dir
        root.mkdir(parents=True, exist_ok=True)
        _sweep(root)
        self._place = root / f"{os.getpid()}-{new_id()}"
        self._lock = _made(self._place)
        self._spooled_before, tempfile.tempdir = tempfile.tempdir, str(self._place)

    @property
    def place(self) -> Path:
        """The directory of this process."""
        return self._place

    def close(self) -> None:
        """Forgets what is left and lets go of the directory."""
        if tempfile.tempdir == str(self._place):
            tempfile.tempdir = self._spooled_before
        shutil.rmtree(self._place, ignore_errors=True)
        self._lock.close()

    @contextmanager
    def kept(self, source: BinaryIO, filename: str | None) -> Generator[Upload]:
        """Copies a file to the disk, piece by piece; forgotten at the end unless it was moved.

        Raises:
            Problem: When the disk has no room for it (507).
        """
        directory = self._place / new_id()
        try:
            try:
                self._check_room()
                directory.mkdir()
                digest, size = _copied(source, directory / "input")
            except OSError as error:
                raise Problem(
                    507,
                    "no-room",
                    f"The upload could not be stored ({error.strerror}); try again later.",
                    headers={"Retry-After": "60"},
                ) from error
            yield Upload(directory=directory, filename=filename, digest=digest, size=size)
        finally:
            shutil.rmtree(directory, ignore_errors=True)

    def _check_room(self) -> None:
        if shutil.disk_usage(self._place).free < self._settings.min_free_disk_bytes:
            raise no_room()


class UploadsAtOnce:
    """Bounds how many forms come in and are worked on at once, in all and of one visitor.

    Args:
        app: What is behind it.
        settings: They say how many.
    """

    def __init__(self, app: ASGIApp, *, settings: Settings) -> None:
        self._app = app
        self._settings = settings
        self._open = Streams(settings.max_uploads, settings.max_uploads_of_visitor, "uploads")

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handles one request."""
        if scope["type"] != "http" or not _is_form(scope):
            await self._app(scope, receive, send)
            return
        try:
            with self._open.opened(address_of(HTTPConnection(scope))):
                self._check_room(scope)
                await self._app(scope, receive, send)
        except Problem as problem:
            if "expect" not in Headers(scope=scope):  # who waits for a word sends nothing yet
                await forget(receive)
            await problem.response()(scope, receive, send)

    def _check_room(self, scope: Scope) -> None:
        """Refuses what the disk would not hold before any of it has come."""
        length = Headers(scope=scope).get("content-length", "")
        coming = int(length) if length.isdecimal() and len(length) < 16 else 0
        settings = self._settings
        try:
            free = shutil.disk_usage(settings.uploads_dir).free
        except OSError as error:
            raise no_room() from error
        if free < settings.min_free_disk_bytes + min(coming, settings.max_upload_bytes):
            raise no_room()


class FormRequest(Request):
    """A request whose form has few and small parts besides the file."""

    def form(
        self,
        *,
        max_files: int | float = MOST_FILES,
        max_fields: int | float = MOST_FIELDS,
        max_part_size: int = LARGEST_FIELD_BYTES,
    ) -> AwaitableOrContextManager[FormData]:
        """The form; what is more than that is refused."""
        return super().form(max_files=max_files, max_fields=max_fields, max_part_size=max_part_size)


class FormRoute(APIRoute):
    """A route that takes such forms."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """The handler of a request, which gets it as a ``FormRequest``."""
        handle = super().get_route_handler()

        async def handle_form(request: Request) -> Response:
            return await handle(FormRequest(request.scope, request.receive))

        return handle_form


def no_room() -> Problem:
    """For a disk that is nearly full."""
    return Problem(
        507,
        "no-room",
        "The disk of the service is nearly full; try again later.",
        headers={"Retry-After": "60"},
    )


def _is_form(scope: Scope) -> bool:
    kind = Headers(scope=scope).get("content-type", "").partition(";")[0].strip().lower()
    return scope["method"] not in SAFE_METHODS and kind in FORMS


def _copied(source: BinaryIO, path: Path) -> tuple[str, int]:
    """Copies a file and has the disk keep it; its digest and size."""
    digest, size = hashlib.sha256(), 0
    with open(path, "xb") as file:
        while piece := source.read(PIECE_BYTES):
            digest.update(piece)
            size += file.write(piece)
        file.flush()
        os.fsync(file.fileno())
    return digest.hexdigest(), size


def _made(place: Path) -> IO[str]:
    """A directory that others leave alone while its lock, which comes back, is open.

    It gets its name when it is locked: nobody may find it before.
    """
    aside = place.with_name(f".{place.name}")
    aside.mkdir(mode=0o700)
    lock = open(aside / LOCK, "w")  # noqa: SIM115 (held for the life of the process)
    flock(lock, LOCK_EX | LOCK_NB)
    aside.rename(place)
    return lock


def _sweep(root: Path) -> None:
    """Removes what nobody holds."""
    for left in root.iterdir():
        if left.name.startswith("."):
            continue  # just being made
        if left.is_symlink() or not left.is_dir():
            left.unlink(missing_ok=True)
        elif not _held(left):
            shutil.rmtree(left, ignore_errors=True)


def _held(place: Path) -> bool:
    """Whether a living process has the lock of a directory."""
    try:
        with open(place / LOCK) as lock:
            flock(lock, LOCK_EX | LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False
