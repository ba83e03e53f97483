"""Connections: limits on their number, and on the time without requests or reads."""

from __future__ import annotations

import asyncio
import logging
import socket
from functools import partial
from ipaddress import ip_address, ip_network
from typing import Any, Final, cast

import h11
from uvicorn.protocols.http.flow_control import service_unavailable
from uvicorn.protocols.http.h11_impl import H11Protocol

from foldback.server.errors import TooMany
from foldback.server.http.event_rate import (
    BYTES_PER_EVENT,
    HEADER_FIELDS_PER_EVENT,
    REQUEST_EVENTS,
    EventBudget,
    GatedTransport,
    Pace,
)
from foldback.server.http.request_rate import EXEMPT_PATH
from foldback.server.http.websocket_protocol import BoundedWebSocket
from foldback.server.limits.concurrency_quota import Permit, Quota
from foldback.server.limits.networks import visitor_at
from foldback.server.settings import Settings

MAX_HEADER_FIELDS: Final = 100
"""Maximum number of header fields of an HTTP request; a request with more is answered with 400. The
default of Apache httpd."""
log = logging.getLogger("foldback.serve")


class Connections:
    """Open connections, counted by visitor and network."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.budget = EventBudget(settings)
        self._proxies = tuple(ip_network(name, strict=False) for name in settings.trusted_proxies)
        self._open = Quota(
            "connections",
            total=settings.max_connections,
            per_visitor=settings.max_connections_of_visitor,
        )
        # for ``/health`` only, so that monitoring works under full load
        self._spare = Quota("connections", total=64, per_visitor=4)

    def visitor(self, host: str) -> str | None:
        """Return the visitor at the other end of a connection; None for a trusted proxy."""
        try:
            address = ip_address(host)
        except ValueError:
            return None  # a Unix socket: a proxy on the same machine
        proxied = any(address in network for network in self._proxies)
        return None if proxied else visitor_at(host)

    def opened(self, visitor: str | None, transport: GatedTransport) -> tuple[Permit | None, bool]:
        """Count a new connection.

        Returns:
            The connection's permit, or None if the limit is reached; True if it is a spare one.
        """
        for quota in (self._open, self._spare):
            try:
                return quota.enter(visitor, end=transport.abort), quota is self._spare
            except TooMany:
                continue
        return None, False


def protocol_of(settings: Settings) -> type[H11Protocol]:
    """Return an HTTP protocol with the limits of the settings."""
    connections = Connections(settings)

    class BoundedProtocol(_BoundedProtocol):
        bounds = connections

    return BoundedProtocol


class CountingConnection(h11.Connection):
    """Parser that counts events, and parses none while its protocol is held."""

    def __init__(self, protocol: _BoundedProtocol, most_bytes: int) -> None:
        super().__init__(h11.SERVER, most_bytes)
        self._protocol = protocol

    def next_event(self) -> Any:
        """Parse and charge one event; none while the protocol is held."""
        if self._protocol.pace.held:
            return h11.NEED_DATA
        event = super().next_event()
        if isinstance(event, h11.Request):
            fields = len(event.headers)
            self._protocol.charge(REQUEST_EVENTS + fields / HEADER_FIELDS_PER_EVENT, request=True)
            if fields > MAX_HEADER_FIELDS:
                raise h11.RemoteProtocolError(
                    f"got {fields} header fields, expected at most {MAX_HEADER_FIELDS}"
                )
        elif isinstance(event, h11.EndOfMessage):
            self._protocol.charge(1 + len(event.headers) / HEADER_FIELDS_PER_EVENT)  # of a trailer
        elif isinstance(event, h11.Data):
            self._protocol.charge(1 + len(event.data) / BYTES_PER_EVENT)
        return event


class _BoundedProtocol(H11Protocol):
    """HTTP protocol that closes connections of clients that send or read nothing for too long."""

    bounds: Connections
    pace: Pace

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Count a new connection and start its timeouts."""
        gate = GatedTransport(transport, self.loop)
        super().connection_made(cast("Any", gate))
        host = self.client[0] if self.client else ""
        self._visitor = self.bounds.visitor(host)
        self.pace = Pace(gate, self.loop, self.bounds.budget, self.handle_events)
        most_bytes = cast("int", self.config.h11_max_incomplete_event_size)
        self.conn = CountingConnection(self, most_bytes)
        self._looking: asyncio.TimerHandle | None = None
        self._permit, self._spare = self.bounds.opened(self._visitor, gate)
        if self._permit is None:
            transport.abort()
            return
        if self._spare:
            self.app = _only_health(self.app)
            self._looking = self.loop.call_later(2.0, transport.abort)
            return
        _bound_unacknowledged(transport, self.bounds.settings.unread_seconds)
        self._since = self.loop.time()
        self._answered: object = None
        self._unread = 0
        self._unread_since = self._since
        self._look()

    def connection_lost(self, exc: Exception | None) -> None:
        """Return the permit of the connection."""
        super().connection_lost(exc)
        self.pace.end()
        self._look_no_more()
        if self._permit is not None:
            self._permit.leave()

    def data_received(self, data: bytes) -> None:
        """Parse received data as far as the event rate permits."""
        self.charge(1)
        super().data_received(data)

    def charge(self, events: float, *, request: bool = False) -> None:
        """Count events for the visitor of the connection, or of its last request."""
        visitor = self._visitor
        if visitor is None and (cycle := cast("Any", self.cycle)) and cycle.scope["client"]:
            visitor = visitor_at(cycle.scope["client"][0])  # as reported by the proxy
        self.pace.charge(visitor, events, request=request)

    def handle_websocket_upgrade(self, event: Any) -> None:
        """Hand a connection and its permit over to the websocket protocol."""
        self._look_no_more()
        if self._spare or self._permit is None:
            self.transport.abort()
            return
        self.ws_protocol_class = cast(
            "Any",
            partial(BoundedWebSocket, permit=self._permit, pace=self.pace, visitor=self._visitor),
        )
        super().handle_websocket_upgrade(event)

    def _look_no_more(self) -> None:
        if self._looking is not None:
            self._looking.cancel()
            self._looking = None

    def _look(self) -> None:
        settings, now = self.bounds.settings, self.loop.time()
        cycle = cast("Any", self.cycle)
        if cycle is not self._answered or not (cycle is None or cycle.response_complete):
            # There was a request since the last check, even if it is already answered.
            self._since, self._answered = now, cycle
        elif now - self._since > settings.header_seconds:
            self.transport.abort()
            return
        unread = self.transport.get_write_buffer_size()
        if unread == 0 or unread != self._unread:
            self._unread, self._unread_since = unread, now
        elif now - self._unread_since > settings.unread_seconds:
            log.info(
                "closed the connection of a client that read nothing for %g s",
                settings.unread_seconds,
            )
            self.transport.abort()
            return
        every = min(2.0, settings.header_seconds / 4, settings.unread_seconds / 4)
        self._looking = self.loop.call_later(every, self._look)


def _only_health(app: Any) -> Any:
    """Return an application that serves only ``/health``."""

    async def answer(scope: Any, receive: Any, send: Any) -> None:
        await (app if scope["path"] == EXEMPT_PATH else service_unavailable)(scope, receive, send)

    return answer


def _bound_unacknowledged(transport: asyncio.Transport, seconds: float) -> None:
    """Let the kernel close a connection whose peer acknowledges no data for some time."""
    handle = transport.get_extra_info("socket")
    if handle is not None and handle.family in (socket.AF_INET, socket.AF_INET6):
        handle.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(1e3 * seconds))
