"""Class connections: the short link of a class, its leader and its followers."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Final

import segno
from fastapi import APIRouter, Request, WebSocket, WebSocketDisconnect
from fastapi.responses import RedirectResponse, Response
from starlette.requests import HTTPConnection

from foldback.server.http.base_path import BASE_PATH
from foldback.server.http.client_address import address_of
from foldback.server.http.websockets import close, first_of, receive
from foldback.server.live_class.live_classes import LiveClass, LiveClasses, is_view
from foldback.server.store.fold_files import NoSuchFoldError
from foldback.server.viewing.fold_lookup import ADDRESS_ID, viewing_of

router = APIRouter(include_in_schema=False)
MAX_VIEWS_PER_SECOND: Final = 30
"""Maximum number of changes of camera or frame that the leader of a class (a shared live 3D view of
a fold) may send per second; more of them end the class. Pages send 10."""
DONE, REFUSED = 1000, 1008
LEFT: Final = {1000, 1001}
"""Codes with which a connection ends if its page closes it or is left (RFC 6455, section 7.4.1);
any other, such as uvicorn's 1005, means that the connection is lost."""
OVER: Final = "over"
"""Reason with which followers are disconnected when their class ends."""


def classes_of(request: HTTPConnection) -> LiveClasses:
    """Return the live classes of the application that a request or a websocket is for."""
    classes: LiveClasses = request.app.state.context.classes
    return classes


@router.get("/c/{code}")
async def join(request: Request, code: str) -> Response:
    """Redirect to the fold that a class of viewers is watching."""
    live_class = classes_of(request).find(code)
    return RedirectResponse(f"/folds/{live_class.fold_id}?class={code.upper()}", status_code=303)


@router.websocket("/api/class/lead")
async def lead(websocket: WebSocket) -> None:
    """Receive what a class's leader sees, and report the number of followers."""
    classes, query_params = classes_of(websocket), websocket.query_params
    if "key" in query_params:
        await _lead(websocket, classes.find_led(query_params.get("code", ""), query_params["key"]))
        return
    fold_id = query_params.get("fold", "")
    with classes.leaders.enter(address_of(websocket)):
        if not ADDRESS_ID.fullmatch(fold_id):
            raise NoSuchFoldError(fold_id)
        if await asyncio.to_thread(viewing_of(websocket).store.find, fold_id) is None:
            raise NoSuchFoldError(fold_id)
        # The class counts for this visitor until it ends, even if its leader reconnects.
        with classes.begun(fold_id) as new_class, contextlib.suppress(TimeoutError):
            async with asyncio.timeout(8 * 3600.0):
                await _lead(websocket, new_class)
                await new_class.wait_abandoned(60.0)


@router.websocket("/api/class/follow")
async def follow(websocket: WebSocket) -> None:
    """Send a follower the leader's views of a class, a shared session."""
    classes = classes_of(websocket)
    followed_class = classes.find(websocket.query_params.get("code", ""))
    with classes.followers.enter(address_of(websocket)), followed_class.joined():
        await websocket.accept()
        await first_of(
            _send_changes(websocket, followed_class, lambda: followed_class.view),
            receive(websocket),
        )
    await close(websocket, *((DONE, OVER) if followed_class.over else (REFUSED, "")))


async def _lead(websocket: WebSocket, live_class: LiveClass) -> None:
    """Let a connection lead a class until it is lost or replaced, or ends the class."""
    live_class.change(leader=websocket)
    try:
        await websocket.accept()
        await first_of(
            _report(websocket, live_class),
            _take_views(websocket, live_class),
            live_class.wait_without(websocket),
        )
    finally:
        if live_class.leader is websocket:
            live_class.change(leader=None, lost_at=asyncio.get_running_loop().time())
        await close(websocket, DONE)


async def _take_views(websocket: WebSocket, live_class: LiveClass) -> None:
    """Receive views; an invalid view, too many views, or leaving the page end the class."""
    clock = asyncio.get_running_loop().time
    second, count = 0, 0
    try:
        while is_view(text := await receive(websocket)):
            now = int(clock())
            second, count = now, (count + 1 if now == second else 1)
            if count > MAX_VIEWS_PER_SECOND:
                break
            if text != live_class.view:
                live_class.change(view=text)
    except WebSocketDisconnect as disconnection:
        if disconnection.code not in LEFT:
            return
    live_class.change(over=True)


async def _report(websocket: WebSocket, live_class: LiveClass) -> None:
    """Send a leader the link, the key for reconnecting, and the number of followers."""
    link = f"http{str(websocket.base_url)[2:].rstrip('/')}{BASE_PATH.get()}/c/{live_class.code}"
    picture = segno.make_qr(link, error="m").svg_data_uri(scale=4, border=4, light="#fff")
    handle = {"code": live_class.code, "key": live_class.key}
    await websocket.send_json({"link": link, "picture": picture, "back": handle})
    await _send_changes(
        websocket,
        live_class,
        lambda: f'{{"followers": {live_class.followers}}}',
        sent='{"followers": 0}',
    )


async def _send_changes(
    websocket: WebSocket, live_class: LiveClass, text: Callable[[], str], *, sent: str | None = None
) -> None:
    """Send a text after each change, until the class is over; skip all but the latest."""
    while not live_class.over:
        changed = live_class.changed
        if (now := text()) == sent:
            await changed.wait()
            continue
        sent = now
        async with asyncio.timeout(20.0):
            await websocket.send_text(now)
        await asyncio.sleep(0.1)
