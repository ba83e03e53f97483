"""Forwarded addresses: the client of a request as its proxy reports it."""

from __future__ import annotations

from collections.abc import Sequence
from ipaddress import ip_address
from typing import Final

from starlette.types import ASGIApp
from uvicorn.middleware.proxy_headers import (
    ProxyHeadersMiddleware,
    _TrustedHosts,  # pyright: ignore[reportPrivateUsage]
)

MAX_PROXIES: Final = 16
"""Maximum number of addresses in X-Forwarded-For that are read, from the last one on: one for each
proxy."""


class ForwardedAddress(ProxyHeadersMiddleware):
    """Middleware that replaces the address of a trusted proxy by that of its client.

    A client that is no address counts as its proxy. Otherwise each text would be a visitor of its
    own.

    Args:
        app: Inner ASGI application.
        proxies: Addresses and networks of the trusted proxies.
    """

    def __init__(self, app: ASGIApp, *, proxies: Sequence[str]) -> None:
        super().__init__(app, list(proxies))  # pyright: ignore[reportArgumentType]
        self.trusted_hosts = _Proxies(list(proxies))


class _Proxies(_TrustedHosts):
    def get_trusted_client_address(self, x_forwarded_for: str) -> tuple[str, int]:
        """Return the last address that is no trusted proxy; an empty text if it is no address."""
        latest = ",".join(x_forwarded_for.rsplit(",", MAX_PROXIES)[-MAX_PROXIES:])
        host, port = super().get_trusted_client_address(latest)
        try:
            ip_address(host)
        except ValueError:
            return "", 0
        return host, port
