"""Upload limits: size and duration of a body, parts of a form, and concurrent uploads."""

from __future__ import annotations

import asyncio
from typing import Final

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from foldback.planner.readers.limits import megabytes
from foldback.server.errors import ServiceError, not_stored
from foldback.server.http.client_address import address_of
from foldback.server.http.problems import response_of
from foldback.server.http.security import SAFE_METHODS
from foldback.server.limits.concurrency_quota import Quota
from foldback.server.limits.disk_space import check_space
from foldback.server.settings import Settings

FORM_MEDIA_TYPES: Final = ("multipart/form-data", "application/x-www-form-urlencoded")
MAX_FORM_FILES: Final = 2
"""Maximum number of files in an uploaded form; a form with more is refused."""
MAX_FORM_FIELDS: Final = 32
"""Maximum number of fields in an uploaded form, besides files; a form with more is refused."""
MAX_FORM_FIELD_BYTES: Final = 16 * 1024
"""Maximum size of one field of an uploaded form that is not a file, in bytes; a form with a larger
one is refused. Fields are held in memory."""
FORM_OVERHEAD_BYTES: Final = 64 * 1024
"""Number of bytes by which an upload request may exceed the limit of an uploaded file, for the
other fields of its form."""
MAX_DRAIN_S: Final = 10.0
"""Maximum time for which the body of a refused upload is read and discarded before the connection
is closed, in s, so that slow clients get the answer as well."""


class BodyLimit:
    """Middleware that refuses bodies above a limit before they fill memory or disk.

    Args:
        app: Inner ASGI application.
        most_bytes: Maximum size of an upload.
        seconds: Maximum duration of an upload, s.
        idle_s: Maximum time without data, s.
    """

    def __init__(
        self, app: ASGIApp, *, most_bytes: int, seconds: float = 120.0, idle_s: float = 15.0
    ) -> None:
        self._app = app
        self._most_bytes = most_bytes
        self._seconds = seconds
        self._idle_s = idle_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http" or scope["method"] in SAFE_METHODS:
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        upload = headers.get("content-type", "").lower().startswith("multipart/form-data")
        # such bodies are held in memory
        max_bytes = self._most_bytes if upload else min(self._most_bytes, 64 * 1024)
        words = (
            f"the upload is larger than the limit of {megabytes(max_bytes)}; use a coarser shape "
            "or a "
            "smaller file."
        )
        announced_bytes = announced(headers)
        received = 0
        has_more = True
        loop = asyncio.get_running_loop()
        deadline = loop.time() + self._seconds

        async def receive_counted() -> Message:
            nonlocal received, has_more
            if not has_more:  # the only message after the body is the disconnection
                return await receive()
            left_s = min(self._idle_s, deadline - loop.time())
            message = await asyncio.wait_for(receive(), max(0.0, left_s))
            if message["type"] == "http.request":
                received += len(message.get("body", b""))
                has_more = message.get("more_body", False)
            return message

        async def receive_bounded() -> Message:
            try:
                message = await receive_counted()
                # The stated length counts at once; otherwise a parser that reaches its own limit
                # in the first part would cause a different response.
                if max(received, announced_bytes) > max_bytes + FORM_OVERHEAD_BYTES:
                    if has_more:
                        await forget(receive)
                    raise HTTPException(413, words)
            except TimeoutError:
                raise HTTPException(408, "the upload took too long; try again.") from None
            return message

        await self._app(scope, receive_bounded, send)


def announced(headers: Headers) -> int:
    """Return the content length that a request states, or 0."""
    length = headers.get("content-length", "")
    return int(length) if length.isascii() and length.isdigit() and len(length) < 21 else 0


async def forget(receive: Receive) -> None:
    """Read the rest of a refused body, within limits.

    Many clients read the response only after they have sent the whole body.
    """
    received = 0
    try:
        async with asyncio.timeout(MAX_DRAIN_S):
            while received <= 64 * 2**20:  # so that the client gets the answer
                message = await receive()
                received += len(message.get("body", b""))
                if not message.get("more_body", False):
                    return
    except TimeoutError:
        return


class UploadsAtOnce:
    """Middleware that limits concurrent uploads of forms, in total and per visitor.

    Args:
        app: Inner ASGI application.
        settings: Contain the limits.
    """

    def __init__(self, app: ASGIApp, *, settings: Settings) -> None:
        self._app = app
        self._settings = settings
        self._open = Quota(
            "uploads", total=settings.max_uploads, per_visitor=settings.max_uploads_of_visitor
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http" or not _is_form(scope):
            await self._app(scope, receive, send)
            return
        try:
            with self._open.enter(address_of(HTTPConnection(scope))):
                self._check_room(scope)
                await self._app(scope, receive, send)
        except ServiceError as refusal:
            if "expect" not in Headers(scope=scope):  # a client that waits for 100 sends no body
                await forget(receive)
            await response_of(refusal)(scope, receive, send)

    def _check_room(self, scope: Scope) -> None:
        """Refuse an upload that would not fit on the disk before any of it is read."""
        settings = self._settings
        needed = min(announced(Headers(scope=scope)), settings.max_upload_bytes)
        try:
            check_space(settings.uploads_dir, settings.min_free_disk_bytes, needed=needed)
        except OSError as error:
            raise not_stored("upload", error) from error


def _is_form(scope: Scope) -> bool:
    kind = Headers(scope=scope).get("content-type", "").partition(";")[0].strip().lower()
    return scope["method"] not in SAFE_METHODS and kind in FORM_MEDIA_TYPES
