"""Viewers: the 3D view of a fold, and the messages between its timeline bar and its player.

``/folds/{id}/view/{visitor}/`` is viser's client; its websocket at the same path is carried to the
visitor's viser server on the loopback interface. ``/folds/{id}/control/{visitor}`` is a websocket
of JSON messages, described in ``web.player``, with one more: ``hello`` with ``viewer``, a word that
changes whenever the viewer behind it had to be made anew. ``/folds/{id}/sketch/{visitor}`` sends
the same view as small frames for the page's own drawing, described in ``web.sketch``.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
from collections.abc import AsyncGenerator, Awaitable, Callable
from pathlib import Path
from typing import Any, Final, cast

import msgspec
import websockets
from fastapi import APIRouter, Request, WebSocket, WebSocketDisconnect
from fastapi.responses import Response
from websockets.typing import Subprotocol

from server.addresses import address_of
from server.routes.finding import Found, find_fold
from web.client import MESSAGES_IN, client
from web.player import Player
from web.viewers import VISITOR, Viewer, Viewers, ViewersBusy

log = logging.getLogger(__name__)
router = APIRouter(include_in_schema=False)

LARGEST_MESSAGE: Final = 64 * 1024
GOING_AWAY, REFUSED, TRY_LATER = 1001, 1008, 1013
OpenViewer = Callable[[], Awaitable[Viewer | None]]
"""The viewer to connect to; None when there is no such view."""
Listen = Callable[[Callable[[Any], None]], Callable[[], None]]
"""Begins to send messages to somebody; what it returns ends that."""
SKETCH: Final = "sketch frame"
COALESCED: Final = ("state", "outline", "module", "waiting", SKETCH)


@router.get("/folds/{fold_id}/view/{visitor}/")
async def view_page(request: Request, fold_id: str, visitor: str) -> Response:
    """Viser's client, to be framed by the fold's page."""
    found = await find_fold(request.app, fold_id)
    return client_page(request, found is not None and VISITOR.fullmatch(visitor) is not None)


def client_page(request: Request, known: bool) -> Response:
    """Viser's client, if there is something to see."""
    if not known:
        return Response("There is no such view.", status_code=404, media_type="text/plain")
    page = client()
    headers = {
        "Content-Security-Policy": page.policy,
        "Cache-Control": "private, no-cache",
        "ETag": page.etag,
        "X-Frame-Options": "SAMEORIGIN",
    }
    if request.headers.get("if-none-match") == page.etag:
        return Response(status_code=304, headers=headers)
    return Response(page.html, media_type="text/html", headers=headers)


@router.websocket("/folds/{fold_id}/view/{visitor}")
async def view_socket(websocket: WebSocket, fold_id: str, visitor: str) -> None:
    """Carries viser's messages between a browser and the visitor's viser server."""
    await carry_view(websocket, _opener(websocket, fold_id, visitor))


async def carry_view(websocket: WebSocket, open_viewer: OpenViewer) -> None:
    """Carries viser's messages between a browser and a viewer."""
    async with _viewer(websocket, open_viewer) as viewer:
        if viewer is None:
            return
        offered = [Subprotocol(p) for p in websocket.scope.get("subprotocols", [])]
        try:
            async with websockets.connect(
                f"ws://127.0.0.1:{viewer.port}",
                subprotocols=offered or None,
                compression=None,
                max_size=None,
                ping_interval=None,
                open_timeout=5,
            ) as inner:
                await websocket.accept(subprotocol=inner.subprotocol)
                await _first_of(_inward(websocket, inner, viewer), _outward(websocket, inner))
        except (OSError, TimeoutError, websockets.WebSocketException) as error:
            log.info("view of %s ended: %s", viewer.fold_id, error)
        await _close(websocket, GOING_AWAY)


@router.websocket("/folds/{fold_id}/control/{visitor}")
async def control_socket(websocket: WebSocket, fold_id: str, visitor: str) -> None:
    """Carries the timeline bar's messages to the visitor's player, and back."""
    await carry_control(websocket, _opener(websocket, fold_id, visitor))


@router.websocket("/folds/{fold_id}/sketch/{visitor}")
async def sketch_socket(websocket: WebSocket, fold_id: str, visitor: str) -> None:
    """Tells a page what to draw on its own canvas; takes the canvas's aspect."""
    async with _viewer(websocket, _opener(websocket, fold_id, visitor)) as viewer:
        if viewer is not None:
            player = cast("Player", viewer.player)
            await _converse(websocket, viewer, player.watch)


async def carry_control(websocket: WebSocket, open_viewer: OpenViewer) -> None:
    """Carries a page's messages to what plays in a viewer, and back."""
    async with _viewer(websocket, open_viewer) as viewer:
        if viewer is not None:
            hello = {"is": "hello", "viewer": viewer.epoch}
            await _converse(websocket, viewer, viewer.player.subscribe, hello)


async def _converse(
    websocket: WebSocket, viewer: Viewer, listen: Listen, *first: dict[str, Any]
) -> None:
    """Sends a browser what ``listen`` brings, after ``first``, and does what it asks for."""
    await websocket.accept()
    outbox = _Outbox(asyncio.get_running_loop())
    for message in first:
        outbox.put(message)
    leave = await asyncio.to_thread(listen, outbox.put_from_thread)
    try:
        await _first_of(_commands(websocket, viewer), outbox.drain(websocket))
    finally:
        leave()
    await _close(websocket, GOING_AWAY)


def _opener(websocket: WebSocket, fold_id: str, visitor: str) -> OpenViewer:
    async def open_viewer() -> Viewer | None:
        found: Found | None = None
        if VISITOR.fullmatch(visitor):
            found = await find_fold(websocket.app, fold_id)
        if found is None:
            return None
        viewers = cast("Viewers", websocket.app.state.context.viewers)
        timeline: Path = found.directory / "timeline.zarr"
        address = address_of(websocket)
        return await asyncio.to_thread(viewers.open, fold_id, visitor, timeline, address=address)

    return open_viewer


@contextlib.asynccontextmanager
async def _viewer(websocket: WebSocket, open_viewer: OpenViewer) -> AsyncGenerator[Viewer | None]:
    """The visitor's viewer for as long as a socket lasts; None when the socket was refused."""
    try:
        viewer = await open_viewer()
    except ViewersBusy as busy:
        await _refuse(websocket, TRY_LATER, str(busy))
        yield None
        return
    if viewer is None:
        await _refuse(websocket, REFUSED, "no such view")
        yield None
        return
    with viewer.connected():
        yield viewer


async def _refuse(websocket: WebSocket, code: int, reason: str) -> None:
    await websocket.accept(subprotocol=next(iter(websocket.scope.get("subprotocols", [])), None))
    await _close(websocket, code, reason)


async def _close(websocket: WebSocket, code: int, reason: str = "") -> None:
    """Closes a socket that may be closed already."""
    with contextlib.suppress(RuntimeError, WebSocketDisconnect):
        await websocket.close(code, reason)


async def _first_of(*works: Any) -> None:
    """Runs all until one ends, then ends the others."""
    tasks = [asyncio.ensure_future(work) for work in works]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    for task in done:
        if not task.cancelled() and task.exception() is not None:
            error = task.exception()
            if not isinstance(
                error, WebSocketDisconnect | websockets.ConnectionClosed | RuntimeError
            ):
                raise cast("BaseException", error)


async def _inward(websocket: WebSocket, inner: websockets.ClientConnection, viewer: Viewer) -> None:
    """Browser to viser: only the kinds of message that a look at a fold needs."""
    while True:
        message = await websocket.receive()
        if message["type"] == "websocket.disconnect":
            return
        data = message.get("bytes")
        if data is None or len(data) > LARGEST_MESSAGE or _kind(data) not in MESSAGES_IN:
            continue
        viewer.touch()
        await inner.send(data)


async def _outward(websocket: WebSocket, inner: websockets.ClientConnection) -> None:
    """Viser to browser."""
    async for data in inner:
        await websocket.send_bytes(data if isinstance(data, bytes) else data.encode())


def _kind(data: bytes) -> str | None:
    try:
        found = msgspec.msgpack.decode(data)
    except (msgspec.MsgspecError, ValueError):
        return None
    return found.get("type") if isinstance(found, dict) else None  # pyright: ignore


async def _commands(websocket: WebSocket, viewer: Viewer) -> None:
    """Hands commands to the player; of seeks that queue up while it works only the last counts."""
    waiting: asyncio.Queue[dict[str, Any] | None] = asyncio.Queue(maxsize=256)

    async def receive() -> None:
        try:
            while True:
                text = await websocket.receive_text()
                if len(text) > LARGEST_MESSAGE:
                    continue
                with contextlib.suppress(ValueError):
                    message = json.loads(text)
                    if isinstance(message, dict):
                        await waiting.put(cast("dict[str, Any]", message))
        except (WebSocketDisconnect, RuntimeError, KeyError):
            await waiting.put(None)

    async def work() -> None:
        while True:
            message = await waiting.get()
            while message is not None and message.get("do") == "seek" and not waiting.empty():
                following = waiting.get_nowait()
                if following is None or following.get("do") != "seek":
                    await asyncio.to_thread(viewer.player.handle, message)
                message = following
            if message is None:
                return
            if message.get("do") != "ping":
                viewer.touch()
            await asyncio.to_thread(viewer.player.handle, message)

    await _first_of(receive(), work())


class _Outbox:
    """Messages on their way to a browser; a newer state replaces one that still waits."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._messages: dict[object, dict[str, Any] | bytes] = {}
        self._count = 0
        self._filled = asyncio.Event()

    def put_from_thread(self, message: dict[str, Any] | bytes) -> None:
        with contextlib.suppress(RuntimeError):  # the loop may be closing
            self._loop.call_soon_threadsafe(self.put, message)

    def put(self, message: dict[str, Any] | bytes) -> None:
        kind = SKETCH if isinstance(message, bytes) else message.get("is")
        self._count += 1
        key: object = kind if kind in COALESCED else self._count
        self._messages.pop(key, None)
        self._messages[key] = message
        self._filled.set()

    async def drain(self, websocket: WebSocket) -> None:
        """Sends for ever."""
        while True:
            await self._filled.wait()
            self._filled.clear()
            batch, self._messages = self._messages, {}
            for message in batch.values():
                if isinstance(message, bytes):
                    await websocket.send_bytes(message)
                else:
                    await websocket.send_text(json.dumps(message, separators=(",", ":")))
