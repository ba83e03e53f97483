"""Limited streams: responses that hold a permit of a quota, and are sent within a maximum time."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Iterator, Mapping

from fastapi.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from server.limits.concurrency_quota import Permit


class LimitedStream(StreamingResponse):
    """An answer that is computed as it is sent.

    Args:
        parts: The answer.
        permit: Its permit of a quota.
        media_type: Its media type.
        headers: Further headers.
        longest_s: Maximum time to send it, s.
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
        # Who takes it too slowly is hung up on; not to send the end does that.
        with self._permit, contextlib.suppress(TimeoutError):
            async with asyncio.timeout(self._longest_s):
                await super().__call__(scope, receive, send)
