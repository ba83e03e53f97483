"""Classes: a leader's view, live for all who follow.

A view is the part of an address that says what is seen (docs/links.md); nothing else is passed on.
A class is in the memory of the web process that its leader is connected to, and ends with that
connection.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
import secrets
from collections.abc import Coroutine, Generator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, cast

import segno
from fastapi import APIRouter, Request, WebSocket, WebSocketDisconnect
from fastapi.responses import RedirectResponse, Response

from server.api.finding import ADDRESS_ID
from server.errors import NoSuch, TooMany
from server.http.base_path import BASE_PATH
from server.http.client_address import address_of
from server.limits.quota import OPEN_RETRY_S, Quota
from server.store.folds import NoSuchFoldError

if TYPE_CHECKING:
    from server.api.context import Context
    from server.settings import Settings

router = APIRouter(include_in_schema=False)
CODE_LETTERS: Final = "23456789ABCDEFGHJKLMNPQRSTUVWXYZ"
"""Characters of a code: those that people do not confuse, as codes are read aloud."""
CODE_LENGTH: Final = 12
"""Length of the code of a class, 60 bits. A smaller value makes codes easier to guess. Chosen."""
MAX_FOLLOWERS: Final = 100
"""Maximum number of followers of one class. A larger value delays views and other visitors."""
MAX_CLASS_S: Final = 8 * 3600.0
"""Time after which a class ends, in s. A larger value leaves forgotten classes open. Chosen."""
VIEW_INTERVAL_S: Final = 0.1
"""Minimum time between two views that one follower gets, in s; those in between are dropped. A
larger value makes motions jerk; a smaller one takes more processor time. Chosen."""
MAX_VIEWS_PER_SECOND: Final = 30
"""Maximum number of views that a leader may send per second; more of them end the class. Pages
send 10. A larger value lets one leader take more processor time. Chosen."""
UNREAD_S: Final = 20.0
"""Time after which a follower that reads nothing is disconnected, in s. A smaller value
disconnects followers after short network failures. Chosen."""
MAX_VIEW_LENGTH: Final = 200
"""Maximum length of a view, in characters: all words with their longest values are shorter."""
VIEW_WORDS: Final = {
    "frame": re.compile(r"[0-9]{1,9}"),
    "module": re.compile(r"[0-9]{1,9}"),
    "camera": re.compile(r"(-?[0-9.]{1,11})?(,(-?[0-9.]{1,11})?){2}((,-?[0-9.]{1,11}){2})?"),
    "colour": re.compile(r"[a-z_-]{1,20}"),
    "path": re.compile(r"1"),
    "follow": re.compile(r"0"),
}
"""Words of a view and their values; the page that shows a view reads them as strictly."""
DONE, REFUSED = 1000, 1008
OVER: Final = "over"
"""Reason with which followers are disconnected when their class ends."""


@dataclass(slots=True, eq=False)
class _Class:
    """One class: what its leader sees now.

    Attributes:
        fold_id: Its fold.
        view: The view; empty for that of the page.
        followers: Number of followers.
        over: True once it has ended.
        changed: Set at the next change of these values, which replaces it.
    """

    fold_id: str
    view: str = ""
    followers: int = 0
    over: bool = False
    changed: asyncio.Event = field(default_factory=asyncio.Event)

    def change(self, **values: Any) -> None:
        for name, value in values.items():
            setattr(self, name, value)
        before, self.changed = self.changed, asyncio.Event()
        before.set()

    @contextlib.contextmanager
    def joined(self) -> Generator[None]:
        """Count a follower.

        Raises:
            TooMany: If there are as many as there may be.
        """
        if self.followers >= MAX_FOLLOWERS:
            detail = f"{MAX_FOLLOWERS} people follow this class, which is the limit."
            raise TooMany("class-full", detail, retry_after_s=OPEN_RETRY_S)
        self.change(followers=self.followers + 1)
        try:
            yield
        finally:
            self.change(followers=self.followers - 1)


class Classes:
    """Classes of one web process, by their codes. Belongs to one event loop."""

    def __init__(self, settings: Settings) -> None:
        self.leaders = Quota(
            "classes", total=settings.max_classes, per_visitor=settings.max_classes_of_visitor
        )
        self.followers = Quota(
            "followers", total=settings.max_followers, per_visitor=settings.max_followers_of_visitor
        )
        self._by_code: dict[str, _Class] = {}

    @contextlib.contextmanager
    def begun(self, fold_id: str) -> Generator[tuple[str, _Class]]:
        """Begin a class, which ends with the context; yield its code too."""
        code = "".join(secrets.choice(CODE_LETTERS) for _ in range(CODE_LENGTH))
        begun = self._by_code[code] = _Class(fold_id)
        try:
            yield code, begun
        finally:
            del self._by_code[code]
            begun.change(over=True)

    def find(self, code: str) -> _Class:
        """Return the class of a code.

        Raises:
            NoSuch: If there is none.
        """
        found = self._by_code.get(code.upper())
        if found is None:
            raise NoSuch("no-class", "This class has ended, or the link is incomplete.")
        return found


def is_view(text: str) -> bool:
    """Return True if a text is a view: known words, each once, with proper values."""
    if not text:
        return True
    words = [part.partition("=") for part in text.split("&", len(VIEW_WORDS))]
    return (
        len(text) <= MAX_VIEW_LENGTH
        and len({name for name, _, _ in words}) == len(words)
        and all(
            name in VIEW_WORDS and VIEW_WORDS[name].fullmatch(value) is not None
            for name, _, value in words
        )
    )


@router.get("/c/{code}")
async def join(request: Request, code: str) -> Response:
    """Lead to the fold that a class sees."""
    found = _context_of(request).classes.find(code)
    return RedirectResponse(f"/folds/{found.fold_id}?class={code.upper()}", status_code=303)


@router.websocket("/api/class/lead")
async def lead(websocket: WebSocket) -> None:
    """Take a leader's views, and report the number of followers."""
    context = _context_of(websocket)
    fold_id = websocket.query_params.get("fold", "")
    with context.classes.leaders.enter(address_of(websocket)):
        if not ADDRESS_ID.fullmatch(fold_id):
            raise NoSuchFoldError(fold_id)
        await asyncio.to_thread(context.store.fold, fold_id)
        with context.classes.begun(fold_id) as (code, shown):
            await websocket.accept()
            link = f"http{str(websocket.base_url)[2:].rstrip('/')}{BASE_PATH.get()}/c/{code}"
            picture = segno.make_qr(link, error="m").svg_data_uri(scale=4, border=4, light="#fff")
            await _first_of(
                _report(websocket, shown, {"link": link, "picture": picture}),
                _take_views(websocket, shown),
                asyncio.sleep(MAX_CLASS_S),
            )
    await _close(websocket, DONE)


@router.websocket("/api/class/follow")
async def follow(websocket: WebSocket) -> None:
    """Send a follower the views of a class."""
    context = _context_of(websocket)
    shown = context.classes.find(websocket.query_params.get("code", ""))
    with context.classes.followers.enter(address_of(websocket)), shown.joined():
        await websocket.accept()
        await _first_of(_send_views(websocket, shown), _receive(websocket))
    await _close(websocket, *((DONE, OVER) if shown.over else (REFUSED, "")))


async def _take_views(websocket: WebSocket, shown: _Class) -> None:
    """Take views until one is none, or there are too many in a second."""
    clock = asyncio.get_running_loop().time
    second, count = 0, 0
    while is_view(text := await _receive(websocket)):
        now = int(clock())
        second, count = now, (count + 1 if now == second else 1)
        if count > MAX_VIEWS_PER_SECOND:
            return
        if text != shown.view:
            shown.change(view=text)


async def _report(websocket: WebSocket, shown: _Class, first: dict[str, str]) -> None:
    """Tell a leader its link, and how many follow."""
    await websocket.send_json(first)
    told = 0
    while True:
        changed = shown.changed
        if shown.followers == told:
            await changed.wait()
            continue
        told = shown.followers
        await _send(websocket, f'{{"followers": {told}}}')


async def _send_views(websocket: WebSocket, shown: _Class) -> None:
    """Send views until the class is over; of those in quick succession the latest."""
    sent: str | None = None
    while not shown.over:
        changed = shown.changed
        if shown.view == sent:
            await changed.wait()
            continue
        sent = shown.view
        await _send(websocket, sent)


async def _send(websocket: WebSocket, text: str) -> None:
    async with asyncio.timeout(UNREAD_S):
        await websocket.send_text(text)
    await asyncio.sleep(VIEW_INTERVAL_S)


async def _receive(websocket: WebSocket) -> str:
    message = await websocket.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect
    text = message.get("text")
    return "bytes" if text is None else text


async def _first_of(*works: Coroutine[Any, Any, object]) -> None:
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


async def _close(websocket: WebSocket, code: int, reason: str = "") -> None:
    with contextlib.suppress(RuntimeError, WebSocketDisconnect):
        await websocket.close(code, reason)


def _context_of(connection: Request | WebSocket) -> Context:
    return cast("Context", connection.app.state.context)
