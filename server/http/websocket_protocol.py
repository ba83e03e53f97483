"""Websocket protocol: limits of a connection after its upgrade."""

from __future__ import annotations

from typing import Any, Final

from uvicorn._types import ASGIReceiveEvent, ASGISendEvent
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame
from websockets.http11 import Request
from websockets.server import ServerProtocol

from foldback.server.http.event_rate import BYTES_PER_EVENT, GatedTransport, Pace
from foldback.server.limits.concurrency_quota import Permit
from foldback.server.limits.networks import visitor_at

CLOSE_HANDSHAKE_S: Final = 1.0
"""Time that a client may take to answer the close frame of a websocket, in s; then the connection
is aborted."""


class _CountingServer(ServerProtocol):
    """Websocket server that counts parsed frames."""

    frames = 0

    def events_received(self) -> list[Request | Frame]:  # type: ignore[override]
        events = super().events_received()
        self.frames += len(events)
        return events  # type: ignore[return-value]


class BoundedWebSocket(WebSocketsSansIOProtocol):
    """Websocket protocol that holds its connection's permit and limits the rate of frames.

    Args:
        permit: Permit of the connection.
        pace: Event count of the connection.
        visitor: Visitor at the other end; None for a proxy.
        more: Arguments of uvicorn's protocol.
    """

    def __init__(self, *, permit: Permit, pace: Pace, visitor: str | None, **options: Any) -> None:
        super().__init__(**options)
        self._permit = permit
        self._pace = pace
        self._visitor = visitor
        self._unparsed = bytearray()
        self.close_timeout = CLOSE_HANDSHAKE_S
        self.conn = _CountingServer(max_size=self.config.ws_max_size, logger=self.logger)
        pace.proceed = self._parse

    def connection_made(self, transport: Any) -> None:
        """Take over a connection from HTTP."""
        assert isinstance(transport, GatedTransport)
        transport.close_s = CLOSE_HANDSHAKE_S
        super().connection_made(transport)  # type: ignore[arg-type]

    def connection_lost(self, exc: Exception | None) -> None:
        """Return the permit."""
        super().connection_lost(exc)
        self._pace.end()
        self._permit.leave()

    def pause_writing(self) -> None:
        """Stop reading from a peer that does not read: each ping would add a waiting pong."""
        super().pause_writing()
        self._gate.hold("unread")

    def resume_writing(self) -> None:
        """Resume reading."""
        super().resume_writing()
        self._gate.release("unread")
        self._parse()

    async def receive(self) -> ASGIReceiveEvent:
        """Return the next event; the frames after it are parsed only then."""
        event = await super().receive()
        self._parse()
        return event

    async def send(self, message: ASGISendEvent) -> None:
        """Send a message; a refusal instead of the handshake completes the handshake."""
        await super().send(message)
        self.handshake_complete = self.handshake_complete or self.close_sent

    def data_received(self, data: bytes) -> None:
        """Parse received data as far as the event rate permits."""
        self._unparsed += data
        self._charge(1)
        self._parse()

    def handle_cont(self, event: Frame) -> None:
        """Collect a fragment."""
        if len(self.frames) >= 256:
            self.transport.abort()
            return
        super().handle_cont(event)

    @property
    def _gate(self) -> GatedTransport:
        assert isinstance(self.transport, GatedTransport)
        return self.transport

    def _parse(self) -> None:
        first = not self.handshake_initiated  # uvicorn passes the whole request head at once
        while self._unparsed and (first or self._gate.reading):
            if self.transport.is_closing():
                self._unparsed.clear()
                return
            # at most 85 frames
            piece = bytes(self._unparsed) if first else bytes(self._unparsed[:512])
            del self._unparsed[: len(piece)]
            before = self.conn.frames
            super().data_received(piece)
            self._charge(self.conn.frames - before + len(piece) / BYTES_PER_EVENT)
            first = False

    def _charge(self, events: float) -> None:
        connection_scope = getattr(self, "scope", None)
        # Behind a proxy the visitor is known only once the application has been called.
        client = connection_scope["client"] if connection_scope is not None else None
        visitor = visitor_at(client[0]) if self._visitor is None and client else self._visitor
        self._pace.charge(visitor, events)
