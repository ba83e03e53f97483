"""Websockets of routes: messages, and concurrent tasks of an open connection."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Coroutine
from typing import Any

from fastapi import WebSocket, WebSocketDisconnect


async def receive(websocket: WebSocket) -> str | bytes:
    """Return the next message.

    Raises:
        WebSocketDisconnect: If the peer has disconnected.
    """
    message = await websocket.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message["code"])
    return message.get("text") or message.get("bytes") or ""


async def first_of(*works: Coroutine[Any, Any, object]) -> None:
    """Run coroutines until one ends or the peer disconnects, then cancel the others."""
    tasks = [asyncio.ensure_future(work) for work in works]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        ended = await asyncio.gather(*tasks, return_exceptions=True)
    disconnections = (asyncio.CancelledError, WebSocketDisconnect, TimeoutError, RuntimeError)
    for error in ended:
        if isinstance(error, Exception) and not isinstance(error, disconnections):
            raise error


async def close(websocket: WebSocket, code: int, reason: str = "") -> None:
    """Close a socket that may be closed already, without waiting for incoming messages."""

    async def drain() -> None:
        while (await websocket.receive())["type"] != "websocket.disconnect":
            pass

    draining = asyncio.ensure_future(drain())
    with contextlib.suppress(RuntimeError, WebSocketDisconnect):
        await websocket.close(code, reason)
    draining.cancel()
    await asyncio.gather(draining, return_exceptions=True)
