"""Preview scenes: what a browser shows of a preview, made when asked for, a few at once."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from pathlib import Path
from typing import Final

from server.previews import KEY, NoSuchPreviewError, Previews, read_report
from server.problems import Problem
from web.preview_scene import preview_scene_of

MOST_AT_ONCE: Final = 4
MOST_BYTES: Final = 32 * 2**20
"""Of scenes that are kept for those who come next."""


class PreviewScenes:
    """Makes the scene of each report once, while it is kept. Belongs to one event loop."""

    def __init__(self, previews: Previews) -> None:
        self._previews = previews
        self._kept: OrderedDict[Path, bytes] = OrderedDict()
        self._making: dict[Path, asyncio.Task[bytes]] = {}

    async def scene(self, preview_id: str, key: str) -> bytes:
        """What ``web.preview_scene`` makes of an upload with the wishes of ``key``.

        Raises:
            NoSuchPreviewError: When there is no such upload or report.
            Problem: When too many scenes are being made (503).
        """
        if not KEY.fullmatch(key):
            raise NoSuchPreviewError(preview_id)
        place = await asyncio.to_thread(self._previews.place, preview_id, key)
        if place in self._kept:
            self._kept.move_to_end(place)
            return self._kept[place]
        task = self._making.get(place)
        if task is None:
            if len(self._making) >= MOST_AT_ONCE:
                raise Problem(
                    503,
                    "busy",
                    f"{len(self._making)} other previews are being drawn; try again in a moment.",
                    headers={"Retry-After": "1"},
                )
            task = self._making[place] = asyncio.create_task(asyncio.to_thread(_made, place))
            task.add_done_callback(lambda task: self._keep(place, task))
        # Who goes away does not take the scene from the others that wait for it.
        return await asyncio.shield(task)

    def _keep(self, place: Path, task: asyncio.Task[bytes]) -> None:
        del self._making[place]
        if task.cancelled() or task.exception() is not None:
            return
        self._kept[place] = task.result()
        while len(self._kept) > 1 and sum(map(len, self._kept.values())) > MOST_BYTES:
            self._kept.popitem(last=False)


def _made(place: Path) -> bytes:
    report = read_report(place)
    if report is None:
        raise NoSuchPreviewError(place.parent.name)
    return preview_scene_of(report)
