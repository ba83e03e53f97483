"""Security: headers of every answer, and the sites whose pages may call the service."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Iterable
from typing import Final
from urllib.parse import unquote, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from planner.readers.limits import megabytes
from server.errors import Forbidden, Malformed, ServiceError
from server.http.problems import Guard

PAGE_POLICY: Final = "; ".join(
    (
        "default-src 'self'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data: blob:",
        "connect-src 'self'",
        "frame-src 'self'",
        "frame-ancestors 'self'",
        "form-action 'self'",
        "base-uri 'none'",
        "object-src 'none'",
    )
)
SECURITY_HEADERS: Final = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "SAMEORIGIN",
    # Nor does a site that a page leads to learn its link.
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=(), payment=(), usb=()",
    # Links are secrets: no search engine tells them.
    "X-Robots-Tag": "noindex, nofollow",
}
INDEXED_HEADERS: Final = {"X-Robots-Tag": "all"}
"""Header of public answers, such as those of the gallery, that permits search engines to index
them; all other answers forbid it."""
CONTROL_CHARACTERS: Final = re.compile(r"[\x00-\x1f\x7f]")
SAFE_METHODS: Final = frozenset({"GET", "HEAD", "OPTIONS"})
LOOPBACK: Final = ("localhost", "127.0.0.1", "::1")
FORM_OVERHEAD_BYTES: Final = 64 * 1024
"""Number of bytes by which an upload request may exceed the limit of an uploaded file, for the
other fields of its form. A smaller value could refuse files of permitted size. Chosen."""
MAX_SMALL_BODY_BYTES: Final = 64 * 1024
"""Maximum size of a request body other than a form with a file, in bytes. Such bodies are held in
memory, so a larger value lets requests take more of it. Chosen."""
MAX_DRAINED_BYTES: Final = 64 * 2**20
"""Maximum number of bytes of a refused upload that are read and discarded before the connection is
closed, so that the client gets the answer. A larger value takes more traffic. Chosen."""
MAX_DRAIN_S: Final = 10.0
"""Maximum time for which the body of a refused upload is read and discarded before the connection
is closed, in s, so that slow clients get the answer as well. A larger value occupies connections
for longer. Chosen."""


class SecurityHeaders:
    """Adds the headers to every answer; a route may set its own instead."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in SECURITY_HEADERS.items():
                    headers.setdefault(name, value)
                headers.setdefault("Content-Security-Policy", PAGE_POLICY)
                # Links are secrets: what is behind them is nothing for caches that many share.
                headers.setdefault("Cache-Control", "private, no-cache")
            await send(message)

        await self._app(scope, receive, send_with_headers)


class AllowedHosts(Guard):
    """Refuses requests under names that are not the service's own.

    Without it a page of another site could have its name point here (DNS rebinding), and would then
    count as one of ours. The address to which a connection was made is the service's own: no name
    leads there under it.
    """

    def __init__(self, app: ASGIApp, *, hosts: Iterable[str]) -> None:
        super().__init__(app)
        self._hosts = frozenset(host.lower() for host in hosts)
        self._any = "*" in self._hosts

    def refusal(self, scope: Scope) -> ServiceError | None:
        """Return the refusal of a foreign name."""
        host = host_name(Headers(scope=scope).get("host", ""))
        own, _ = scope.get("server") or (None, None)
        if self._any or host == own or self._allowed(host):
            return None
        return Malformed(
            "unknown-host",
            f"got the host {host[:100]!r}, expected a name of this service; its operator can add "
            "names with FOLDBACK_ALLOWED_HOSTS.",
        )

    def _allowed(self, host: str) -> bool:
        return host in self._hosts or any(
            allowed.startswith("*.") and host.endswith(allowed[1:]) for allowed in self._hosts
        )


class PrintingAddresses(Guard):
    """Refuses paths and queries with characters that do not print, which no link of ours has.

    Databases and file systems choke on some of them, logs are garbled by others.
    """

    def refusal(self, scope: Scope) -> ServiceError | None:
        """Return the refusal of an address that cannot be printed."""
        if scope["type"] == "http" and CONTROL_CHARACTERS.search(scope["path"] + _query(scope)):
            return Malformed(
                "bad-address", "got an address with characters that cannot be printed."
            )
        return None


def _query(scope: Scope) -> str:
    return unquote(scope["query_string"].decode("latin-1"))


def host_name(host: str) -> str:
    """Return the name in a Host header, without the port, in lower case."""
    host = host.strip().lower()
    if host.startswith("["):
        return host.partition("]")[0].removeprefix("[")
    return host.rpartition(":")[0] if host.count(":") == 1 else host


def hosts_of(host: str, allowed: Iterable[str] = ()) -> tuple[str, ...]:
    """Return the names that a service answers to.

    Args:
        host: The address it listens on.
        allowed: Names that an operator has set. None, on an address that others reach, is any.
    """
    allowed = tuple(host_name(name) for name in allowed)
    if not allowed and host not in LOOPBACK and not host.startswith("127."):
        return ("*",)
    return (*LOOPBACK, host, *allowed)


class SameOrigin(Guard):
    """Refuses websockets and changes that come from pages of other sites.

    Programs other than browsers send no Origin and are let through: they act for nobody else.
    """

    def __init__(self, app: ASGIApp, origins: Iterable[str] = ()) -> None:
        super().__init__(app)
        self._origins = frozenset(origins)

    def refusal(self, scope: Scope) -> ServiceError | None:
        """Return the refusal of a page of another site."""
        acts = scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS
        if not acts or self._allowed(Headers(scope=scope)):
            return None
        return Forbidden(
            "foreign-origin",
            "Pages of other sites are not allowed to change anything on this service.",
        )

    def _allowed(self, headers: Headers) -> bool:
        origin = headers.get("origin")
        if origin is None or origin in self._origins:
            return True
        host = headers.get("host", "").lower()
        try:
            found = urlsplit(origin)
        except ValueError:
            return False
        return found.scheme in ("http", "https") and bool(host) and found.netloc.lower() == host


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
        most = self._most_bytes if upload else min(self._most_bytes, MAX_SMALL_BODY_BYTES)
        words = (
            f"the upload is larger than {megabytes(most)}, the limit; use a coarser or shorter "
            "file."
        )
        told = announced(headers)
        got = 0
        more = True
        loop = asyncio.get_running_loop()
        deadline = loop.time() + self._seconds

        async def receive_counted() -> Message:
            nonlocal got, more
            if not more:  # what comes after the body is only the end of the connection
                return await receive()
            left = min(self._idle_s, deadline - loop.time())
            message = await asyncio.wait_for(receive(), max(0.0, left))
            if message["type"] == "http.request":
                got += len(message.get("body", b""))
                more = message.get("more_body", False)
            return message

        async def receive_bounded() -> Message:
            try:
                message = await receive_counted()
                # What is said to come counts at once: a parser that meets its own limit
                # in the first part of it would give another answer.
                if max(got, told) > most + FORM_OVERHEAD_BYTES:
                    if more:
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

    Clients read the answer only when they could send.
    """
    got = 0
    try:
        async with asyncio.timeout(MAX_DRAIN_S):
            while got <= MAX_DRAINED_BYTES:
                message = await receive()
                got += len(message.get("body", b""))
                if not message.get("more_body", False):
                    return
    except TimeoutError:
        return
