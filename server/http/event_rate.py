"""Event rates: limits on the protocol events of a connection, a visitor and all visitors.

Parsing costs processor time per event (a chunk, a frame, a request, a header field) more than per
byte: 256 kB hold 43 000 chunks of one byte. After ``SLICE_EVENTS`` events a connection waits for
the next turn of the event loop. Above its rate it is not read for a while; TCP flow control then
slows the peer. Both protocols parse in Python: httptools is faster, but parses a whole read at once
and does not limit the size of headers.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any, Final

from foldback.server.limits.token_buckets import SharedBuckets
from foldback.server.settings import Settings

SLICE_EVENTS: Final = 64
"""Maximum number of protocol events (HTTP requests and chunks, websocket frames) of one connection
that are processed in one turn of the event loop, about 2 ms."""
REQUEST_EVENTS: Final = 20
"""Number of protocol events (HTTP chunks, websocket frames) as which one HTTP request counts in the
rate limit, beyond which a connection is not read for a while. Answering a request costs about 0.5
ms, parsing a chunk or a frame 0.025 ms. Measured."""
BYTES_PER_EVENT: Final = 8192
"""Number of bytes of a request's body or of websocket frames that count as one protocol event, in
addition to the chunks and frames themselves: decoding 64 kB of JSON takes up to 0.8 ms.
Measured."""
HEADER_FIELDS_PER_EVENT: Final = 4
"""Number of HTTP header fields that count as one protocol event (HTTP chunk, websocket frame) in
the rate limit, beyond which a connection is not read for a while."""
EVENT_BURST_S: Final = 5.0
"""Number of protocol events (HTTP chunks, websocket frames) that a visitor or a connection may
cause at once after a pause, in seconds of its permitted rate. With a larger value a burst delays
other visitors for longer: at this value for about 0.5 s."""
MIN_BURST_EVENTS: Final = 1000.0
"""Minimum number of protocol events (HTTP chunks, websocket frames) that a visitor or a connection
may cause at once after a pause, so that a low permitted rate does not stop ordinary page loads."""


class EventBudget(SharedBuckets):
    """Token buckets for events of visitors, networks and all visitors. For one event loop.

    Args:
        settings: Contains the request rate of a visitor.
    """

    def __init__(self, settings: Settings) -> None:
        # twice what the permitted requests count as
        rate = 2.0 * REQUEST_EVENTS * settings.requests_per_second_of_visitor
        burst = max(EVENT_BURST_S * rate, MIN_BURST_EVENTS)
        self.connection_rate = 0.25 * rate  # 1000 of 4000 per second by default
        self.connection_burst = max(EVENT_BURST_S * self.connection_rate, MIN_BURST_EVENTS)
        super().__init__(rate, burst)


class GatedTransport:
    """Transport that reads only while its protocol wants to read and no hold is set.

    Attributes:
        reading: True while bytes are read.
        close_s: Seconds from ``close`` until the connection is aborted if the peer does not read
            the remaining data; None for no limit.
    """

    def __init__(self, transport: Any, loop: asyncio.AbstractEventLoop) -> None:
        self._transport = transport
        self._loop = loop
        self._protocol_reads = True
        self.reading = True
        self._holds: set[str] = set()
        self.close_s: float | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)

    def pause_reading(self) -> None:
        """Stop reading on behalf of the protocol."""
        self._protocol_reads = False
        self._apply()

    def resume_reading(self) -> None:
        """Resume reading on behalf of the protocol, as soon as no hold is set."""
        self._protocol_reads = True
        self._apply()

    def hold(self, reason: str) -> None:
        """Stop reading until this hold is released."""
        self._holds.add(reason)
        self._apply()

    def release(self, reason: str) -> None:
        """Release a hold; resume reading unless another is set or the protocol has paused."""
        self._holds.discard(reason)
        self._apply()

    def close(self) -> None:
        """Close the connection once all written data are sent, or after ``close_s``."""
        closing = self._transport.is_closing()
        self._transport.close()
        if self.close_s is not None and not closing:
            self._loop.call_later(self.close_s, self._transport.abort)

    def _apply(self) -> None:
        reading = self._protocol_reads and not self._holds
        if reading == self.reading or self._transport.is_closing():
            return
        self.reading = reading
        (self._transport.resume_reading if reading else self._transport.pause_reading)()


class Pace:
    """Event count of one connection; it pauses the transport above the permitted rate.

    Args:
        transport: The connection.
        loop: Its event loop.
        budget: Token buckets of all visitors.
        proceed: Parses the data received during a hold, once the hold is released.
    """

    def __init__(
        self,
        transport: GatedTransport,
        loop: asyncio.AbstractEventLoop,
        budget: EventBudget,
        proceed: Callable[[], object],
    ) -> None:
        self._transport = transport
        self._loop = loop
        self._budget = budget
        self.proceed = proceed
        self._tokens = budget.connection_burst
        self._counted = time.monotonic()
        self._slice = 0.0
        self._timer: asyncio.TimerHandle | None = None

    @property
    def held(self) -> bool:
        """True while nothing more may be parsed."""
        return self._timer is not None

    def charge(self, visitor: str | None, events: float, *, request: bool = False) -> None:
        """Count events of a visitor.

        Args:
            visitor: The visitor; None if unknown.
            events: Number of events.
            request: True for the events of a request; these do not count for the connection.
        """
        wait_s = self._budget.charge(visitor, events)
        if not request:
            now, rate = time.monotonic(), self._budget.connection_rate
            earned = (now - self._counted) * rate
            self._tokens = min(self._budget.connection_burst, self._tokens + earned) - events
            self._counted = now
            wait_s = max(wait_s, -self._tokens / rate)
        self._slice += events
        if self._timer is None and (wait_s > 0.0 or self._slice >= SLICE_EVENTS):
            self._transport.hold("events")
            self._timer = self._loop.call_later(max(0.0, wait_s), self._release)

    def end(self) -> None:
        """Cancel the timer of the connection."""
        if self._timer is not None:
            self._timer.cancel()

    def _release(self) -> None:
        self._timer = None
        self._slice = 0.0
        self._transport.release("events")
        if not self._transport.is_closing():
            self.proceed()
