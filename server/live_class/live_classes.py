"""Live classes: a leader's view, shared live with followers.

A view is the part of an address that selects frame, camera and colours (docs/links.md); only views
are passed on. A class exists in the memory of the web process that its leader is connected to. It
ends when the leader closes the page; after a lost connection the leader has some time to return.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
import secrets
from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Any, Final, TypeGuard

from foldback.server.errors import NoSuch, TooMany
from foldback.server.limits.concurrency_quota import OPEN_RETRY_S, Quota
from foldback.server.settings import Settings

CODE_LETTERS: Final = "23456789ABCDEFGHJKLMNPQRSTUVWXYZ"
"""Characters of a code. Similar ones are left out, because codes are read aloud."""
CODE_LENGTH: Final = 12
"""Number of characters of the code in the link to a class (a leader whose 3D view of a fold others
see live), of 32 letters and digits: 60 bits."""
MAX_FOLLOWERS: Final = 100
"""Maximum number of browsers that follow one class (a leader whose 3D view of a fold others see
live); further ones are refused."""
VIEW_WORDS: Final = {
    "frame": re.compile(r"[0-9]{1,9}"),
    "module": re.compile(r"[0-9]{1,9}"),
    "camera": re.compile(r"(-?[0-9.]{1,11})?(,(-?[0-9.]{1,11})?){2}((,-?[0-9.]{1,11}){2})?"),
    "colour": re.compile(r"[a-z_-]{1,20}"),
    "path": re.compile(r"1"),
    "follow": re.compile(r"0"),
}
"""Parameters of a view and their permitted values; the pages' scripts check them as strictly."""


@dataclass(slots=True, eq=False)
class LiveClass:
    """State of one class.

    Attributes:
        fold_id: Id of its fold.
        code: Code with which followers join it.
        key: Secret with which its leader reconnects.
        leader: Connection of its leader; None while disconnected.
        lost_at: Time of the leader's last disconnection, in s of the event loop.
        view: The leader's current view; empty for the initial view of the page.
        followers: Number of followers.
        over: True once the class has ended.
        changed: Event that is set, and replaced by a new one, when these values change.
    """

    fold_id: str
    code: str
    key: str = field(default_factory=lambda: secrets.token_urlsafe(16))
    leader: object = None
    lost_at: float = 0.0
    view: str = ""
    followers: int = 0
    over: bool = False
    changed: asyncio.Event = field(default_factory=asyncio.Event)

    def change(self, **values: Any) -> None:
        """Change values, and wake all tasks that wait for a change."""
        for name, value in values.items():
            setattr(self, name, value)
        before, self.changed = self.changed, asyncio.Event()
        before.set()

    async def wait_without(self, leader: object) -> None:
        """Wait until the class is over or has another leader than the given connection."""
        while not self.over and self.leader is leader:
            await self.changed.wait()

    async def wait_abandoned(self, patience_s: float) -> None:
        """Wait until the class is over or has been without a leader for ``patience_s``."""
        while not self.over:
            end = self.lost_at + patience_s if self.leader is None else None
            try:
                async with asyncio.timeout_at(end):
                    await self.changed.wait()
            except TimeoutError:
                return

    @contextlib.contextmanager
    def joined(self) -> Generator[None]:
        """Count a follower.

        Raises:
            TooMany: If the class has ``MAX_FOLLOWERS`` followers.
        """
        if self.followers >= MAX_FOLLOWERS:
            raise TooMany(
                "class-full",
                "{followers} people are in this class, which is the maximum; try again later.",
                retry_after_s=OPEN_RETRY_S,
                followers=MAX_FOLLOWERS,
            )
        self.change(followers=self.followers + 1)
        try:
            yield
        finally:
            self.change(followers=self.followers - 1)


class LiveClasses:
    """Classes of one web process, by code. For one event loop."""

    def __init__(self, settings: Settings) -> None:
        self.leaders = Quota(
            "classes", total=settings.max_classes, per_visitor=settings.max_classes_of_visitor
        )
        self.followers = Quota(
            "followers", total=settings.max_followers, per_visitor=settings.max_followers_of_visitor
        )
        self._by_code: dict[str, LiveClass] = {}

    @contextlib.contextmanager
    def begun(self, fold_id: str) -> Generator[LiveClass]:
        """Start a class that ends with the context."""
        code = "".join(secrets.choice(CODE_LETTERS) for _ in range(CODE_LENGTH))
        live_class = self._by_code[code] = LiveClass(fold_id, code)
        try:
            yield live_class
        finally:
            del self._by_code[code]
            live_class.change(over=True)

    def find(self, code: str) -> LiveClass:
        """Return the class with a code.

        Raises:
            NoSuch: If there is none.
        """
        live_class = self._by_code.get(code.upper())
        if live_class is None:
            raise NoSuch(
                "no-class",
                "This class has ended, or its link is incomplete; ask the teacher for a new link.",
            )
        return live_class

    def find_led(self, code: str, key: str) -> LiveClass:
        """Return the class that a leader reconnects to.

        Raises:
            NoSuch: If there is none, or it has another key.
        """
        live_class = self.find(code)
        if not secrets.compare_digest(live_class.key.encode(), key.encode()):
            raise NoSuch("no-class", "This class has ended.")
        return live_class


def is_view(text: str | bytes) -> TypeGuard[str]:
    """Return True if a message is a view: known parameters, each once, with valid values."""
    if not isinstance(text, str):
        return False
    if not text:
        return True
    words = [part.partition("=") for part in text.split("&", len(VIEW_WORDS))]
    return (
        len(text) <= 200
        and len({name for name, _, _ in words}) == len(words)
        and all(
            name in VIEW_WORDS and VIEW_WORDS[name].fullmatch(value) is not None
            for name, _, value in words
        )
    )
