"""Websockets of routes: their messages, and works that run side by side while one is open."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any

from fastapi import WebSocket, WebSocketDisconnect


async def receive(websocket: WebSocket) -> str | bytes:
    """Return the next message.

    Raises:
        WebSocketDisconnect: If the peer is gone.
    """
    message = await websocket.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message["code"])
    return message.get("text") or message.get("bytes") or ""


async def first_of(*works: Coroutine[Any, Any, object]) -> None:
    """Wait until one of some works ends or the peer is gone, and cancel the others."""
    tasks = [asyncio.ensure_future(work) for work in works]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        ended = await asyncio.gather(*tasks, return_exceptions=True)
    gone = (asyncio.CancelledError, WebSocketDisconnect, TimeoutError, RuntimeError)
    for error in ended:
        if isinstance(error, Exception) and not isinstance(error, gone):
            raise error
