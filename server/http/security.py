"""Security: headers of all responses, and checks of hosts, addresses and origins."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final
from urllib.parse import unquote, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from foldback.server.errors import Forbidden, Malformed, ServiceError
from foldback.server.http.problems import Guard
from foldback.server.settings import LOOPBACK, is_loopback

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
    # Linked sites do not learn the address of the page, which may be secret.
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=(), payment=(), usb=()",
    # Links are secrets, so search engines must not index them.
    "X-Robots-Tag": "noindex, nofollow",
}
INDEXED_HEADERS: Final = {"X-Robots-Tag": "all"}
"""Header of public responses, such as those of the gallery, that permits search engines to index
them; all other responses forbid it."""
CONTROL_CHARACTERS: Final = re.compile(r"[\x00-\x1f\x7f]")
MAX_ADDRESS_BYTES: Final = 8192
"""Maximum length of the path and the query of an address together, in bytes."""
MAX_QUERY_FIELDS: Final = 64
"""Maximum number of fields in the query of an address; decoding thousands of them would take many
times as long as the rest of a request."""
SAFE_METHODS: Final = frozenset({"GET", "HEAD", "OPTIONS"})


class SecurityHeaders:
    """Middleware that adds security headers to every response, unless the route has set them."""

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
                # Links are secrets, so shared caches must not store their pages.
                control = headers.setdefault("Cache-Control", "private, no-cache")
                if "content-encoding" not in headers and not control.startswith("public"):
                    # A proxy that compresses it would tell its secrets by its length (BREACH).
                    headers["Cache-Control"] = f"{control}, no-transform"
            await send(message)

        await self._app(scope, receive, send_with_headers)


class AllowedHosts(Guard):
    """Middleware that refuses requests under host names that are not the service's own.

    Otherwise another site could let its name point to this service (DNS rebinding), and its pages
    would count as the service's own. The IP address of the connection is always permitted, because
    it is not a name that another site can redirect.
    """

    def __init__(self, app: ASGIApp, *, hosts: Iterable[str]) -> None:
        super().__init__(app)
        self._hosts = frozenset(host.lower() for host in hosts)
        self._any = "*" in self._hosts

    def refusal(self, scope: Scope) -> ServiceError | None:
        """Return the refusal of a foreign name."""
        host = host_name(Headers(scope=scope).get("host", ""))
        own_host, _ = scope.get("server") or (None, None)
        if self._any or host == own_host or self._allowed(host):
            return None
        return Malformed(
            "unknown-host",
            "got the host {host!r}, expected a name of this service; its operator can add names "
            "with FOLDBACK_ALLOWED_HOSTS.",
            host=host[:100],
        )

    def _allowed(self, host: str) -> bool:
        return host in self._hosts or any(
            allowed.startswith("*.") and host.endswith(allowed[1:]) for allowed in self._hosts
        )


class ShortPrintableAddresses(Guard):
    """Middleware that refuses long paths and queries, and those with control characters.

    No link of the service is or contains any. Long ones take time to decode, and some control
    characters cause errors in databases and file systems, or garble logs.
    """

    def refusal(self, scope: Scope) -> ServiceError | None:
        """Return the refusal of an address that is long or has control characters."""
        query: bytes = scope["query_string"]
        fields = query.count(b"&") + 1
        if len(scope["path"]) + len(query) > MAX_ADDRESS_BYTES or fields > MAX_QUERY_FIELDS:
            return Malformed(
                "bad-address",
                "got an address that is too long, expected at most {max_bytes} bytes with "
                "{max_fields} fields; shorten it.",
                max_bytes=MAX_ADDRESS_BYTES,
                max_fields=MAX_QUERY_FIELDS,
            )
        if scope["type"] == "http" and CONTROL_CHARACTERS.search(scope["path"] + _query(scope)):
            return Malformed(
                "bad-address", "got an address with characters that cannot be printed; remove them."
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
    """Return the host names that a service accepts.

    Args:
        host: The address that it listens on.
        allowed: Names set by the operator. If there are none, a public address accepts all names.
    """
    allowed = tuple(host_name(name) for name in allowed)
    if not allowed and not is_loopback(host):
        return ("*",)
    return (*LOOPBACK, host, *allowed)


class SameOrigin(Guard):
    """Middleware that refuses websockets and changes from pages of other sites.

    Requests without Origin are permitted: programs other than browsers act only for their user.
    """

    def __init__(self, app: ASGIApp, origins: Iterable[str] = ()) -> None:
        super().__init__(app)
        self._origins = frozenset(origins)

    def refusal(self, scope: Scope) -> ServiceError | None:
        """Return the refusal of a request from a page of another site."""
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
            address = urlsplit(origin)
        except ValueError:
            return False
        return address.scheme in ("http", "https") and bool(host) and address.netloc.lower() == host
