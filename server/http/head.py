"""HEAD wherever there is GET: the headers of the answer, without its body."""

from __future__ import annotations

import asyncio
from contextlib import suppress

from starlette.types import ASGIApp, Message, Receive, Scope, Send


class HeadAsGet:
    """Answer a HEAD request as the GET of the same address, and end it where the body would begin.

    What makes the body is cancelled, so that a long file or an endless stream costs nothing.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http" or scope["method"] != "HEAD":
            await self._app(scope, receive, send)
            return
        answered = asyncio.Event()
        asked = {**scope, "method": "GET"}

        async def send_head(message: Message) -> None:
            if message["type"] == "http.response.start":
                if "route" in asked:  # logs name routes: addresses may be secrets
                    scope["route"] = asked["route"]
                await send(message)
                return
            if not answered.is_set():
                await send({"type": "http.response.body", "body": b"", "more_body": False})
                answered.set()
            await asyncio.Event().wait()  # until it is cancelled

        making = asyncio.ensure_future(self._app(asked, receive, send_head))
        waiting = asyncio.ensure_future(answered.wait())
        try:
            await asyncio.wait({making, waiting}, return_when=asyncio.FIRST_COMPLETED)
            if making.done():
                await making  # raises what it raised
        finally:
            for task in (making, waiting):
                task.cancel()
                with suppress(asyncio.CancelledError):
                    await task
