"""Fold states: progress of folds, read once for all clients that follow the same fold.

One thread reads the states of all followed folds, one after the other.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Final

from cachetools import TTLCache
from fastapi.sse import ServerSentEvent

from foldback.server.jobs.eta import EtaEstimator
from foldback.server.schemas import progress_of
from foldback.server.store.folds import NoSuchFoldError, Store

STATE_CACHE_S: Final = 0.15
"""Time for which the progress of a running fold is cached for all clients that watch it, in s."""


class FoldStates:
    """Cache of the states of folds that are being watched."""

    def __init__(self, store: Store, remaining: EtaEstimator) -> None:
        self._store = store
        self._remaining = remaining
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="fold-states")
        self._states: TTLCache[str, dict[str, Any]] = TTLCache(1024, STATE_CACHE_S)
        self._looks: dict[str, asyncio.Task[dict[str, Any]]] = {}
        """Unfinished reads by fold; at most one for each, even if the database is slow."""
        self._ending = asyncio.Event()

    def end(self) -> None:
        """End all event streams, so that the service can stop; browsers then reconnect."""
        self._ending.set()

    def close(self) -> None:
        """Start no more reads."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    async def state(self, fold_id: str) -> dict[str, Any]:
        """Return the fold's progress, at most ``STATE_CACHE_S`` old.

        Raises:
            NoSuchFoldError: If there is no such fold.
        """
        if (state := self._states.get(fold_id)) is not None:
            return state
        if (look := self._looks.get(fold_id)) is None:
            look = self._looks[fold_id] = asyncio.create_task(self._read(fold_id))
        return await asyncio.shield(look)

    async def events(self, fold_id: str) -> AsyncIterator[ServerSentEvent]:
        """Yield server-sent events ``progress`` until the fold is over, then ``done``."""
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
                await asyncio.wait_for(self._ending.wait(), STATE_CACHE_S)

    async def _read(self, fold_id: str) -> dict[str, Any]:
        loop = asyncio.get_running_loop()
        try:
            state = await loop.run_in_executor(self._thread, self._look, fold_id)
        finally:
            del self._looks[fold_id]
        self._states[fold_id] = state
        return state

    def _look(self, fold_id: str) -> dict[str, Any]:
        return progress_of(self._store.fold(fold_id), self._remaining)
