"""Access log: one line and one entry in the metrics for every request."""

from __future__ import annotations

import logging
import re
import time
import uuid
from typing import Final

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from foldback.server.ops.logs import from_now_on_about
from foldback.server.ops.metrics import Metrics

REQUEST_ID_HEADER: Final = "X-Request-ID"
REQUEST_ID_PATTERN: Final = re.compile(r"[A-Za-z0-9._-]{1,64}")
LOGGED_FOLD_ID: Final = re.compile(r"[A-Za-z0-9]{1,32}")
LOGGED_METHODS: Final = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})
UNKNOWN_ROUTE: Final = "unknown"
log = logging.getLogger("foldback.access")


class Access:
    """Middleware that gives every request an id (``X-Request-ID``), logs and counts it.

    A valid id in the request is reused, so that this log can be joined with a proxy's. Neither the
    query nor the visitor is logged. The path is logged as the template of its route, or itself if
    no route matches.
    """

    def __init__(self, app: ASGIApp, *, metrics: Metrics) -> None:
        self._app = app
        self._metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] == "websocket":
            with self._metrics.websockets.track_inprogress():
                await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        came = Headers(scope=scope).get(REQUEST_ID_HEADER, "")
        request_id = came if REQUEST_ID_PATTERN.fullmatch(came) else uuid.uuid4().hex
        scope.setdefault("state", {})["request_id"] = request_id
        # Not reset at the end: the server logs failures outside of this middleware.
        from_now_on_about(request=request_id)
        status = 500
        cut = True

        async def send_watched(message: Message) -> None:
            nonlocal status, cut
            if message["type"] == "http.response.start":
                status = message["status"]
                MutableHeaders(scope=message)[REQUEST_ID_HEADER] = request_id
            elif message["type"] == "http.response.body" and not message.get("more_body", False):
                cut = False
            await send(message)

        began = time.perf_counter()
        with self._metrics.in_progress.track_inprogress():
            try:
                await self._app(scope, receive, send_watched)
            finally:
                self._tell(scope, status, time.perf_counter() - began, cut=cut)

    def _tell(self, scope: Scope, status: int, seconds: float, *, cut: bool) -> None:
        method = scope["method"] if scope["method"] in LOGGED_METHODS else "other"
        route = route_of(scope)
        self._metrics.count(method=method, route=route, status=status, seconds=seconds)
        fold_id = str(scope.get("path_params", {}).get("fold_id", ""))
        place = route if route != UNKNOWN_ROUTE else scope["path"][:200]
        log.info(
            "%s %s %d in %.1f ms%s",
            *(method, place, status, 1e3 * seconds, ", cut off" if cut else ""),
            extra={
                "method": method,
                "route": route,
                "path": place if route == UNKNOWN_ROUTE else None,
                "status": status,
                "duration_ms": round(1e3 * seconds, 1),
                "fold": fold_id if LOGGED_FOLD_ID.fullmatch(fold_id) else None,
            },
        )


def route_of(scope: Scope) -> str:
    """Return the template of the answering route, as ``/folds/{fold_id}``, or unknown."""
    route_path = getattr(scope.get("route"), "path", None)
    return route_path if isinstance(route_path, str) else UNKNOWN_ROUTE


def request_id_of(scope: Scope) -> dict[str, str]:
    """Return the header with a request's id, for responses created outside of ``Access``."""
    request_id = scope.get("state", {}).get("request_id")
    return {REQUEST_ID_HEADER: request_id} if request_id else {}
