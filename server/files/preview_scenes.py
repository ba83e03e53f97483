"""Preview scenes: the 3D scene of a preview, computed on request, a few at once."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Final

from server.files.preview_reports import OFFERS_FILE, OPTIONS_KEY, cells_of_repair, read_report
from server.limits.single_flight import SingleFlight
from server.store.previews import NoSuchPreviewError, Previews
from web.timeline.cache import Cache
from web.viser.preview_scene import preview_scene_of

SCENES_AT_ONCE: Final = 2
"""Number of 3D scenes for previews of shapes that are built at the same time; others wait. A larger
value takes more memory. Chosen."""
MAX_PENDING_SCENES: Final = 8
"""Maximum number of 3D scenes for previews that are being built or wait for it; further requests
are refused. A larger value makes clients wait longer instead. Chosen."""
MAX_PENDING_SCENES_OF_VISITOR: Final = 3
"""Maximum number of one visitor's 3D scenes for previews that are being built or wait for it;
further requests are refused. With a larger value one visitor delays others more. Chosen."""
MAX_SCENE_CACHE_BYTES: Final = 32 * 2**20
"""Maximum total size of the 3D scenes of previews that are cached in memory, in bytes. A smaller
value builds scenes again more often. Chosen."""


class PreviewScenes:
    """Cache of the scenes of reports. For one event loop."""

    def __init__(self, previews: Previews) -> None:
        self._previews = previews
        self._cache: Cache[bytes] = Cache(MAX_SCENE_CACHE_BYTES, len)
        self._flight = SingleFlight(
            "previews",
            at_once=SCENES_AT_ONCE,
            total=MAX_PENDING_SCENES,
            per_visitor=MAX_PENDING_SCENES_OF_VISITOR,
        )

    def close(self) -> None:
        """Start no further computation."""
        self._flight.close()

    async def scene(
        self, preview_id: str, key: str, *, visitor: str, repair: bool = False
    ) -> bytes:
        """Return the scene of an upload with the options of ``key``.

        Args:
            preview_id: The upload's.
            key: Key of the options.
            visitor: Client that asks.
            repair: Also show the cells that an offered repair for a table adds.

        Raises:
            NoSuchPreviewError: When there is no such upload or report.
            ServiceError: When too many scenes of the visitor are being made, or of all.
        """
        if not OPTIONS_KEY.fullmatch(key):
            raise NoSuchPreviewError(preview_id)
        place = await asyncio.to_thread(self._previews.place, preview_id, key)
        name = place / OFFERS_FILE if repair else place
        return await self._flight.get_or_make(
            name, lambda: _made(place, repair=repair), visitor=visitor, cache=self._cache
        )


def _made(place: Path, *, repair: bool) -> bytes:
    report = read_report(place)
    if report is None:
        raise NoSuchPreviewError(place.parent.name)
    if repair:
        report = {**report, "added": cells_of_repair(place)}
    return preview_scene_of(report)
