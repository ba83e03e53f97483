"""Viewers: one small viser server per visitor of a fold, on the loopback interface only.

Each has its own playhead, so that two people on one link don't fight over a slider. A viewer is
thrown away when nobody is connected for a while, and made anew from the timeline when its visitor
comes back.
"""

from __future__ import annotations

import contextlib
import logging
import re
import secrets
import threading
import time
import weakref
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any, Final, Protocol

import rich
import viser
from viser._messages import ShareUrlDisconnect, ShareUrlRequest

from planner.errors import TimelineError
from web.film import Film
from web.player import Listener, Message, Player

log = logging.getLogger(__name__)

VISITOR: Final = re.compile(r"[A-Za-z0-9_-]{16,64}")
TICK_S: Final = 1 / 30
REST_S: Final = 0.1
FORGOTTEN_AFTER: Final = 30.0
"""A viewer that is connected but untouched for this many idle times counts as forgotten."""
MOST_SOCKETS: Final = 12
"""Of one viewer: a page has three, and twice as many for a moment after a break."""


class ViewersBusy(Exception):
    """No viewer can be opened now; the message says what to do."""


class Playing(Protocol):
    """What drives the scene of a viewer; see ``web.player`` and ``web.preview``."""

    def subscribe(self, listener: Listener) -> Callable[[], None]:
        """Sends every message out to ``listener`` too, until what is returned is called."""
        ...

    def handle(self, message: Message) -> None:
        """Does what a message says."""
        ...

    def tick(self, now: float) -> None:
        """Lets time pass up to ``now``."""
        ...


class Viewer:
    """One visitor's viser server and player."""

    def __init__(
        self,
        fold_id: str,
        visitor: str,
        make: Callable[[viser.ViserServer], Playing],
        *,
        address: str = "",
    ) -> None:
        self.fold_id = fold_id
        self.visitor = visitor
        self.address = address
        self.epoch = secrets.token_hex(6)
        self.connections = 0
        self.touched = time.monotonic()
        with _quiet():
            self.server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        _close_share_url(self.server)
        self.server.gui.configure_theme(show_logo=False, show_share_button=False)
        self.player = make(self.server)

    @property
    def port(self) -> int:
        """The loopback port of the viser server."""
        return int(self.server.get_port())

    def touch(self) -> None:
        """Notes that the visitor is there."""
        self.touched = time.monotonic()

    @contextlib.contextmanager
    def connected(self) -> Generator[None]:
        """Counts a connection for as long as it lasts."""
        self.connections += 1
        self.touch()
        try:
            yield
        finally:
            self.connections -= 1
            self.touch()

    def stop(self) -> None:
        """Closes the server and everything connected to it."""
        with _quiet():
            self.server.stop()


class Films:
    """Open films by path, shared while anybody looks."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._films: weakref.WeakValueDictionary[str, Film] = weakref.WeakValueDictionary()

    def get(self, timeline: Path) -> Film | None:
        """The film of a timeline, or None when there is none yet."""
        key = str(timeline)
        with self._lock:
            film = self._films.get(key)
            if film is None:
                try:
                    film = Film(timeline)
                except (TimelineError, OSError, ValueError, KeyError):
                    return None
                self._films[key] = film
        film.refresh()
        return film


class Viewers:
    """All viewers of a process; closes what nobody looks at.

    Their number is bounded in all, for one address and for one fold. Where a bound is reached, a
    viewer that nobody is connected to makes room: one of the same address before all others.
    """

    def __init__(
        self,
        max_viewers: int = 200,
        idle_s: float = 60.0,
        *,
        max_of_address: int | None = None,
        max_of_fold: int | None = None,
    ) -> None:
        self.max_viewers = max_viewers
        self.max_of_address = max_of_address or max_viewers
        self.max_of_fold = max_of_fold or max_viewers
        self.idle_s = idle_s
        self._lock = threading.RLock()
        self._viewers: dict[tuple[str, str], Viewer] = {}
        self._films = Films()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="viewers", daemon=True)
        self._thread.start()

    def __len__(self) -> int:
        return len(self._viewers)

    def open(self, fold_id: str, visitor: str, timeline: Path, *, address: str = "") -> Viewer:
        """The viewer of a visitor of a fold, made when there is none.

        Args:
            fold_id: What is looked at.
            visitor: A token for one visit; somebody with several pages has several.
            timeline: Where the fold's timeline is.
            address: Where the visitor comes from.

        Raises:
            ValueError: For a visitor token of the wrong form.
            ViewersBusy: When there are too many, and all of them are in use.
        """
        return self.opened(
            fold_id,
            visitor,
            lambda server: Player(server, lambda: self._films.get(timeline)),
            address=address,
        )

    def opened(
        self,
        what: str,
        visitor: str,
        make: Callable[[viser.ViserServer], Playing],
        *,
        address: str = "",
    ) -> Viewer:
        """The same for whatever can be looked at; ``make`` makes what plays in a new viewer."""
        if not VISITOR.fullmatch(visitor):
            raise ValueError("expected a visitor token of 16 to 64 letters, digits, - and _.")
        key = (what, visitor)
        with self._lock:
            if self._stop.is_set():
                raise ViewersBusy("The server is closing; try again in a moment.")
            viewer = self._viewers.get(key)
            if viewer is None:
                self._make_room(what, address)
                viewer = self._viewers[key] = Viewer(what, visitor, make, address=address)
            elif viewer.connections >= MOST_SOCKETS:
                raise ViewersBusy("This view has too many connections; load the page again.")
        viewer.touch()
        viewer.player.tick(time.monotonic())
        return viewer

    def close(self) -> None:
        """Closes all viewers for good."""
        self._stop.set()
        self._thread.join(timeout=2.0)
        with self._lock:
            viewers = list(self._viewers.values())
            self._viewers.clear()
        for viewer in viewers:
            viewer.stop()

    def _make_room(self, what: str, address: str) -> None:
        """Closes viewers that nobody is connected to, until none of the bounds is reached."""
        bounds: tuple[tuple[int, Callable[[Viewer], bool], str], ...] = (
            (
                self.max_of_address,
                lambda viewer: viewer.address == address,
                "You have {} views open, which is the most there may be; close one and try again.",
            ),
            (
                self.max_of_fold,
                lambda viewer: viewer.fold_id == what,
                "All {} viewers of this fold are in use; try again in a few minutes.",
            ),
            (
                self.max_viewers,
                lambda viewer: True,
                "All {} viewers are in use; try again in a few minutes.",
            ),
        )
        for most, counts, words in bounds:
            counted = [key for key, viewer in self._viewers.items() if counts(viewer)]
            if len(counted) < most:
                continue
            free = [key for key in counted if not self._viewers[key].connections]
            if not free:
                raise ViewersBusy(words.format(most))
            self._viewers.pop(min(free, key=lambda k: self._rank(k, address))).stop()

    def _rank(self, key: tuple[str, str], address: str) -> tuple[bool, float]:
        """What is closed first: what is of the same address, then what is longest unused."""
        viewer = self._viewers[key]
        return (viewer.address != address, viewer.touched)

    def _evict(self, now: float) -> None:
        with self._lock:
            gone = [
                key
                for key, v in self._viewers.items()
                if now - v.touched > self.idle_s * (FORGOTTEN_AFTER if v.connections else 1.0)
            ]
            viewers = [self._viewers.pop(key) for key in gone]
        for viewer in viewers:
            viewer.stop()

    def _run(self) -> None:
        next_eviction = time.monotonic()
        while not self._stop.is_set():
            started = time.monotonic()
            if started >= next_eviction:
                next_eviction = started + min(1.0, self.idle_s / 4)
                self._evict(started)
            with self._lock:
                viewers = [v for v in self._viewers.values() if v.connections]
            for viewer in viewers:
                try:
                    viewer.player.tick(time.monotonic())
                except Exception:
                    log.exception("the viewer of fold %s could not go on", viewer.fold_id)
            spent = time.monotonic() - started
            self._stop.wait(max(0.002, (TICK_S if viewers else REST_S) - spent))


def _close_share_url(server: viser.ViserServer) -> None:
    """Takes away viser's offer to open a tunnel to a third party."""
    websocket: Any = server._websock_server  # pyright: ignore[reportPrivateUsage]
    for message in (ShareUrlRequest, ShareUrlDisconnect):
        websocket.unregister_handler(message)


_QUIET_LOCK: Final = threading.RLock()


@contextlib.contextmanager
def _quiet() -> Generator[None]:
    """Keeps viser's banner off the terminal, which it prints whatever ``verbose`` says."""
    console = rich.get_console()
    with _QUIET_LOCK:
        before, console.quiet = console.quiet, True
        try:
            yield
        finally:
            console.quiet = before
