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
        answered = asyncio.get_running_loop().create_future()
        asked = {**scope, "method": "GET"}

        async def send_head(message: Message) -> None:
            if message["type"] == "http.response.start":
                if "route" in asked:  # logs name routes: addresses may be secrets
                    scope["route"] = asked["route"]
                await send(message)
                return
            if not answered.done():
                await send({"type": "http.response.body", "body": b"", "more_body": False})
                answered.set_result(None)
            await asyncio.Event().wait()  # until it is cancelled

        making = asyncio.ensure_future(self._app(asked, receive, send_head))
        try:
            await asyncio.wait({making, answered}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            making.cancel()
            with suppress(asyncio.CancelledError):
                await making  # raises what it raised
