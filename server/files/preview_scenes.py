"""Preview scenes: what a browser shows of a preview, made when asked for, a few at once."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Final

from server.files.previews import (
    KEY,
    OFFERS,
    NoSuchPreviewError,
    Previews,
    cells_of_repair,
    read_report,
)
from server.limits.single_flight import SingleFlight
from web.timeline.cache import Cache
from web.viser.preview_scene import preview_scene_of

AT_ONCE: Final = 2
MOST_WAITING: Final = 8
MOST_OF_VISITOR: Final = 3
MOST_BYTES: Final = 32 * 2**20
"""Bytes of scenes in the cache."""


class PreviewScenes:
    """Makes the scene of each report once, while it is kept. Belongs to one event loop."""

    def __init__(self, previews: Previews) -> None:
        self._previews = previews
        self._cache: Cache[bytes] = Cache(MOST_BYTES, len)
        self._flight = SingleFlight(
            "previews", at_once=AT_ONCE, total=MOST_WAITING, per_visitor=MOST_OF_VISITOR
        )

    def close(self) -> None:
        """Begins nothing any more."""
        self._flight.close()

    async def scene(
        self, preview_id: str, key: str, *, visitor: str, repair: bool = False
    ) -> bytes:
        """Return the scene of an upload with the options of ``key``.

        Args:
            preview_id: The upload's.
            key: Of the options.
            visitor: Client that asks.
            repair: Also show the cells that an offered repair for a table adds.

        Raises:
            NoSuchPreviewError: When there is no such upload or report.
            ServiceError: When too many scenes of the visitor are being made, or of all.
        """
        if not KEY.fullmatch(key):
            raise NoSuchPreviewError(preview_id)
        place = await asyncio.to_thread(self._previews.place, preview_id, key)
        name = place / OFFERS if repair else place
        if (known := self._cache.get(name)) is not None:
            return known
        made = await self._flight.get_or_make(
            name, lambda: _made(place, repair=repair), visitor=visitor
        )
        self._cache.keep(name, made)
        return made


def _made(place: Path, *, repair: bool) -> bytes:
    report = read_report(place)
    if report is None:
        raise NoSuchPreviewError(place.parent.name)
    if repair:
        report = {**report, "added": cells_of_repair(place)}
    return preview_scene_of(report)
