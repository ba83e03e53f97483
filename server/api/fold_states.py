"""Fold states: the state of folds as it changes, read once for all who look at the same fold."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from typing import Any, Final

from cachetools import TTLCache
from fastapi.sse import ServerSentEvent

from server.api.schemas import progress_of
from server.jobs.remaining import Remaining
from server.store.folds import NoSuchFoldError, Store

LOOK_EVERY_S: Final = 0.15
MOST_KEPT: Final = 1024


class FoldStates:
    """Keeps each looked-at state for a moment."""

    def __init__(self, store: Store, remaining: Remaining) -> None:
        self._store = store
        self._remaining = remaining
        self._looks: TTLCache[str, asyncio.Task[dict[str, Any]]] = TTLCache(MOST_KEPT, LOOK_EVERY_S)
        self._ending = asyncio.Event()

    def end(self) -> None:
        """Lets all who follow go, so that the service can end; browsers come back by themselves."""
        self._ending.set()

    async def state(self, fold_id: str) -> dict[str, Any]:
        """The fold's progress, at most ``LOOK_EVERY_S`` old.

        Raises:
            NoSuchFoldError: When there is no such fold.
        """
        look = self._looks.get(fold_id)
        if look is None:
            look = asyncio.create_task(asyncio.to_thread(self._look, fold_id))
            self._looks[fold_id] = look
        return await asyncio.shield(look)

    async def events(self, fold_id: str) -> AsyncIterator[ServerSentEvent]:
        """Server-sent events ``progress`` until the fold is over, then ``done``."""
        last: dict[str, Any] | None = None
        while not self._ending.is_set():
            try:
                state = await self.state(fold_id)
            except NoSuchFoldError:
                yield ServerSentEvent(event="done", data={"status": "deleted"})
                return
            if state != last:
                yield ServerSentEvent(event="progress", data=state)
                last = state
                if state["status"] not in ("queued", "running"):
                    yield ServerSentEvent(event="done", data=state)
                    return
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._ending.wait(), LOOK_EVERY_S)

    def _look(self, fold_id: str) -> dict[str, Any]:
        return progress_of(self._store.fold(fold_id), self._remaining)
