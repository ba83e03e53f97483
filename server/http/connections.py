"""Connections: how many there may be, and how long each may be silent or take nothing."""

from __future__ import annotations

import asyncio
import logging
from ipaddress import ip_address, ip_network
from typing import TYPE_CHECKING, Any, Final, cast

from uvicorn.protocols.http.h11_impl import H11Protocol

from server.errors import TooMany
from server.limits.networks import visitor_at
from server.limits.quota import Permit, Quota

if TYPE_CHECKING:
    from server.settings import Settings

LOOK_EVERY_S: Final = 2.0
log = logging.getLogger("foldback.serve")


class Connections:
    """Counts connections by the addresses that they come from."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._proxies = tuple(ip_network(name, strict=False) for name in settings.trusted_proxies)
        self._open = Quota(
            "connections", total=None, per_visitor=settings.max_connections_of_visitor
        )

    def opened(self, host: str) -> Permit | None:
        """Counts one more; its permit, or None when there may be no more."""
        try:
            return self._open.enter(None if self._proxy(host) else visitor_at(host))
        except TooMany:
            return None

    def _proxy(self, host: str) -> bool:
        """Whether many visitors may come from an address."""
        try:
            address = ip_address(host)
        except ValueError:
            return True  # a socket in the file system: a proxy of the same machine
        return any(address in network for network in self._proxies)


def protocol_of(settings: Settings) -> type[H11Protocol]:
    """What speaks HTTP with those who connect, within the settings' bounds."""
    connections = Connections(settings)

    class BoundedProtocol(_BoundedProtocol):
        bounds = connections

    return BoundedProtocol


class _BoundedProtocol(H11Protocol):
    """Hangs up on clients that say nothing, or take nothing, for too long."""

    bounds: Connections

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Looks after a new connection from here on."""
        super().connection_made(transport)
        host = self.client[0] if self.client else ""
        self._permit = self.bounds.opened(host)
        self._looking: asyncio.TimerHandle | None = None
        if self._permit is None:
            transport.abort()
            return
        self._since = self.loop.time()
        self._answered: object = None
        self._unread = 0
        self._unread_since = self._since
        self._look()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forgets a connection."""
        super().connection_lost(exc)
        self._leave()

    def handle_websocket_upgrade(self, event: Any) -> None:
        """Leaves a connection to the protocol of websockets, which has bounds of its own."""
        self._leave()
        super().handle_websocket_upgrade(event)

    def _leave(self) -> None:
        if self._looking is not None:
            self._looking.cancel()
            self._looking = None
        if self._permit is not None:
            self._permit.leave()
            self._permit = None

    def _look(self) -> None:
        settings, now = self.bounds.settings, self.loop.time()
        cycle = cast("Any", self.cycle)
        if cycle is not self._answered or not (cycle is None or cycle.response_complete):
            # It has asked for something since the last look, however quickly that was answered.
            self._since, self._answered = now, cycle
        elif now - self._since > settings.header_seconds:
            self.transport.abort()
            return
        unread = self.transport.get_write_buffer_size()
        if unread == 0 or unread != self._unread:
            self._unread, self._unread_since = unread, now
        elif now - self._unread_since > settings.unread_seconds:
            log.info("hung up on a client that took nothing for %g s", settings.unread_seconds)
            self.transport.abort()
            return
        every = min(LOOK_EVERY_S, settings.header_seconds / 4, settings.unread_seconds / 4)
        self._looking = self.loop.call_later(every, self._look)
