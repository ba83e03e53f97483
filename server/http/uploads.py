"""Forms: how many come in at once, and how many parts each may have."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any, Final

from fastapi import Request, Response
from fastapi.routing import APIRoute
from starlette.datastructures import FormData, Headers
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Receive, Scope, Send

from server.errors import ServiceError, nearly_full
from server.http.client_address import address_of
from server.http.problems import response_of
from server.http.security import SAFE_METHODS, forget
from server.limits.quota import Quota
from server.settings import Settings

if TYPE_CHECKING:
    from starlette._utils import AwaitableOrContextManager

FORMS: Final = ("multipart/form-data", "application/x-www-form-urlencoded")
MOST_FILES: Final = 2
MOST_FIELDS: Final = 32
LARGEST_FIELD_BYTES: Final = 16 * 1024


class UploadsAtOnce:
    """Bounds how many forms come in and are worked on at once, in all and of one visitor.

    Args:
        app: What is behind it.
        settings: They say how many.
    """

    def __init__(self, app: ASGIApp, *, settings: Settings) -> None:
        self._app = app
        self._settings = settings
        self._open = Quota(
            "uploads", total=settings.max_uploads, per_visitor=settings.max_uploads_of_visitor
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handles one request."""
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
        """Refuses what the disk would not hold before any of it has come."""
        length = Headers(scope=scope).get("content-length", "")
        coming = int(length) if length.isdecimal() and len(length) < 16 else 0
        settings = self._settings
        try:
            free = shutil.disk_usage(settings.uploads_dir).free
        except OSError as error:
            raise nearly_full() from error
        if free < settings.min_free_disk_bytes + min(coming, settings.max_upload_bytes):
            raise nearly_full()


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


def _is_form(scope: Scope) -> bool:
    kind = Headers(scope=scope).get("content-type", "").partition(";")[0].strip().lower()
    return scope["method"] not in SAFE_METHODS and kind in FORMS
