"""HEAD requests: the headers of the response to GET, without its body."""

from __future__ import annotations

import asyncio
from contextlib import suppress

from starlette.types import ASGIApp, Message, Receive, Scope, Send


class HeadAsGet:
    """Middleware that answers HEAD requests like GET, and ends the response before its body.

    The task that produces the body is cancelled, so that long files and endless streams cost
    nothing.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http" or scope["method"] != "HEAD":
            await self._app(scope, receive, send)
            return
        answered = asyncio.get_running_loop().create_future()
        get_scope = {**scope, "method": "GET"}

        async def send_head(message: Message) -> None:
            if message["type"] == "http.response.start":
                if (
                    "route" in get_scope
                ):  # the log contains routes, because addresses may be secrets
                    scope["route"] = get_scope["route"]
                await send(message)
                return
            if not answered.done():
                await send({"type": "http.response.body", "body": b"", "more_body": False})
                answered.set_result(None)
            await asyncio.Event().wait()  # until it is cancelled

        making = asyncio.ensure_future(self._app(get_scope, receive, send_head))
        try:
            await asyncio.wait({making, answered}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            making.cancel()
            with suppress(asyncio.CancelledError):
                await making  # re-raises errors of the application
