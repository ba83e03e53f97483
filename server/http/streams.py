"""Streams: how much without an end may be open, in all and to one address."""

from __future__ import annotations

from collections import Counter
from collections.abc import AsyncIterator, Generator
from contextlib import contextmanager
from typing import Final

from fastapi.responses import StreamingResponse

from server.errors import TooMany

RETRY_AFTER_S: Final = 10


class Streams:
    """Counts what is open. Used on the event loop alone.

    Args:
        most: How many may be open.
        most_of_address: How many of them to one address.
        what: Their name, in the plural.
    """

    def __init__(self, most: int, most_of_address: int, what: str = "event streams") -> None:
        self._what = what
        self._most = most
        self._most_of_address = most_of_address
        self._open: Counter[str] = Counter()

    def __len__(self) -> int:
        return self._open.total()

    def answer(self, events: AsyncIterator[bytes], address: str) -> StreamingResponse:
        """An answer that counts for as long as it lasts.

        Raises:
            TooMany: When as many are open as there may be.
        """
        self._check(address)
        return StreamingResponse(
            self._counted(events, address),
            media_type="text/event-stream",
            headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"},
        )

    @contextmanager
    def opened(self, address: str) -> Generator[None]:
        """Counts one for as long as it lasts.

        Raises:
            TooMany: When as many are open as there may be.
        """
        self._check(address)
        with self._count(address):
            yield

    def _check(self, address: str) -> None:
        for count, most, whose in (
            (self._open[address], self._most_of_address, "of yours"),
            (len(self), self._most, "in all"),
        ):
            if count >= most:
                raise TooMany(
                    f"too-many-{self._what.rpartition(' ')[2]}",
                    f"{count} {self._what} {whose} are open, which is the most there may be; "
                    f"close one, or try again in {RETRY_AFTER_S} s.",
                    retry_after_s=RETRY_AFTER_S,
                )

    async def _counted(self, events: AsyncIterator[bytes], address: str) -> AsyncIterator[bytes]:
        with self._count(address):
            async for event in events:
                yield event

    @contextmanager
    def _count(self, address: str) -> Generator[None]:
        self._open[address] += 1
        try:
            yield
        finally:
            self._open[address] -= 1
            if not self._open[address]:
                del self._open[address]
