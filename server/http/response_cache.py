"""Response cache: repeated requests within a second get the same response.

A link that many visitors have opened causes many equal requests per second, and a verified fold no
longer changes. A route may therefore mark its response as one of a verified fold. Other clients
then get the same bytes, without a thread, a database query or a route. A fold that is deleted
through this process disappears at once; through another process, after at most a second.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

from cachetools import TTLCache
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from foldback.server.http.security import SAFE_METHODS
from foldback.server.store.fold_source import id_of_fold

RESPONSE_CACHE_S: Final = 1.0
"""Time for which an answer about a verified fold, which no longer changes, is cached for all
clients, in s."""
MAX_RESPONSE_CACHE_BYTES: Final = 16 * 2**20
"""Maximum total size of the cached answers about verified folds, in bytes."""
CACHEABLE_FOLD: Final = "lately"
Key = tuple[str, str, str, bytes]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Answer:
    until: float
    fold_id: str
    headers: dict[str, str]
    body: bytes
    scope_entries: dict[str, Any]
    """Entries of the scope that access log and metrics read, such as the route."""


def mark(request: HTTPConnection, row: Any) -> None:
    """Mark an answer as cacheable: it depends on one verified fold only."""
    if row.status == "verified":
        setattr(request.state, CACHEABLE_FOLD, id_of_fold(row.id))


class ResponseCache:
    """Middleware that caches responses of verified folds; see the module's description.

    Args:
        app: Inner ASGI application.
        clock: Clock in seconds.
    """

    def __init__(self, app: ASGIApp, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._app = app
        self._clock = clock
        # Expired responses remain for other clients while one request computes a new one.
        self._answers: TTLCache[Key, _Answer, float] = TTLCache(
            MAX_RESPONSE_CACHE_BYTES, 2 * RESPONSE_CACHE_S, clock, lambda answer: len(answer.body)
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
        elif scope["method"] == "GET":
            await self._get(scope, receive, send)
        elif scope["method"] in SAFE_METHODS:
            await self._app(scope, receive, send)
        else:
            try:
                await self._app(scope, receive, send)
            finally:
                self._forget(scope.get("path_params", {}).get("fold_id"))

    async def _get(self, scope: Scope, receive: Receive, send: Send) -> None:
        fields = Headers(scope=scope)
        key = (scope["scheme"], fields.get("host", ""), scope["path"], scope["query_string"])
        stored = self._answers.get(key)
        if stored is not None and self._clock() < stored.until:
            scope.update(stored.scope_entries)
            tag = stored.headers.get("etag")
            is_same = tag is not None and fields.get("if-none-match") == tag
            body, status = (b"", 304) if is_same else (stored.body, 200)
            headers = {
                k: v for k, v in stored.headers.items() if not is_same or k != "content-length"
            }
            await Response(body, status, headers)(scope, receive, send)
            return
        if stored is not None:  # only the first request computes it again; others get the old one
            self._answers[key] = replace(stored, until=self._clock() + RESPONSE_CACHE_S)
        start: Message = {}

        async def send_watched(message: Message) -> None:
            nonlocal start
            if message["type"] == "http.response.start":
                start = {**message, "headers": list(message["headers"])}
            elif message["type"] == "http.response.body" and not message.get("more_body", False):
                self._keep(key, scope, start, message.get("body", b""))
            await send(message)

        await self._app(scope, receive, send_watched)
        if stored is not None and self._answers.get(key, stored).body is stored.body:
            self._answers.pop(key, None)

    def _keep(self, key: Key, scope: Scope, start: Message, body: bytes) -> None:
        fold_id = scope.get("state", {}).get(CACHEABLE_FOLD)
        headers = {k.decode("latin-1"): v.decode("latin-1") for k, v in start["headers"]}
        is_whole = headers.get("content-length") == str(len(body))  # not the last part of a stream
        if (
            fold_id is None
            or start["status"] != 200
            or not is_whole
            or len(body) > MAX_RESPONSE_CACHE_BYTES
        ):
            return
        self._answers[key] = _Answer(
            until=self._clock() + RESPONSE_CACHE_S,
            fold_id=fold_id,
            headers=headers,
            body=body,
            scope_entries={name: scope[name] for name in ("route", "path_params") if name in scope},
        )

    def _forget(self, fold_id: str | None) -> None:
        for key in list(self._answers):
            answer = self._answers.get(key)
            if answer is not None and answer.fold_id == fold_id:
                self._answers.pop(key, None)
