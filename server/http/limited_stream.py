"""Limited streams: streaming responses with a permit of a quota and a maximum duration."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Iterator, Mapping

from fastapi.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from foldback.server.limits.concurrency_quota import Permit


class LimitedStream(StreamingResponse):
    """Response that is computed while it is sent.

    Args:
        parts: Parts of the body.
        permit: Permit of a quota; returned when the response ends.
        media_type: Media type.
        headers: Additional headers.
        longest_s: Maximum time for sending the response, s.
    """

    def __init__(
        self,
        parts: Iterator[bytes] | AsyncIterator[bytes],
        permit: Permit,
        *,
        media_type: str,
        headers: Mapping[str, str],
        longest_s: float | None = None,
    ) -> None:
        super().__init__(parts, media_type=media_type, headers=headers)
        self._permit = permit
        self._longest_s = longest_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the response."""
        # Without an end of the body the server closes the connections of clients that read slowly.
        with self._permit, contextlib.suppress(TimeoutError):
            async with asyncio.timeout(self._longest_s):
                await super().__call__(scope, receive, send)
