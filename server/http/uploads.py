"""Forms: how many come in at once, and how many parts each may have."""

from __future__ import annotations

from typing import Final

from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Receive, Scope, Send

from server.errors import ServiceError, not_stored
from server.http.client_address import address_of
from server.http.problems import response_of
from server.http.security import SAFE_METHODS, announced, forget
from server.limits.concurrency_quota import Quota
from server.limits.disk_space import check_space
from server.settings import Settings

FORM_MEDIA_TYPES: Final = ("multipart/form-data", "application/x-www-form-urlencoded")
MAX_FORM_FILES: Final = 2
"""Maximum number of files in an uploaded form; a form with more is refused. A larger value lets a
request take more disk space. Chosen."""
MAX_FORM_FIELDS: Final = 32
"""Maximum number of fields in an uploaded form, besides files; a form with more is refused. A
larger value lets a request take more processor time. Chosen."""
MAX_FORM_FIELD_BYTES: Final = 16 * 1024
"""Maximum size of one field of an uploaded form that is not a file, in bytes; a form with a larger
one is refused. Fields are held in memory. Chosen."""


class UploadsAtOnce:
    """Bounds how many forms come in and are worked on at once, in all and of one visitor.

    Args:
        app: Inner ASGI application.
        settings: They say how many.
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
            if "expect" not in Headers(scope=scope):  # who waits for a word sends nothing yet
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
