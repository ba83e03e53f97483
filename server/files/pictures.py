"""Pictures: social pictures of folds, drawn in a child process.

Drawing takes long, and pages must not wait for it.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from foldback.planner.storage.file_names import CHAIN
from foldback.server.processes.children import Pool
from foldback.server.processes.scratch import MOMENT_FILE, PICTURE, Scratch
from foldback.server.settings import Settings
from foldback.web.timeline.cache import Cache
from foldback.web.timeline.view import TimelineView

MAX_CACHED_PICTURES: Final = 64
"""Maximum number of drawn pictures of folds that are cached in memory, about 0.1 MB each."""


def moment_of(
    caption: Mapping[str, str], view: str | None = None, timeline: TimelineView | None = None
) -> dict[str, Any]:
    """Return the content of a picture, as the process that draws it reads it.

    Args:
        caption: Fields of ``web.pictures.caption.Caption``.
        view: Short form of ``web.pictures.picture_view.PictureView``.
        timeline: The fold's frames; the folded chain is drawn when None.

    Raises:
        TimelineError: If the timeline is damaged or is being replaced.
    """
    frame = None
    if view is not None and timeline is not None and len(timeline):
        index = min(max(int(view.partition(",")[0]) - 1, 0), len(timeline) - 1)
        dense = timeline.motion(index, index + 1).dense(timeline.chain)
        errors = dense.joint_error_rad[0]
        frame = {
            "angles_rad": dense.joint_angles_rad[0].tolist(),
            "position": dense.root_position[0].tolist(),
            "wxyz": dense.root_wxyz[0].tolist(),
            "errors_rad": [None if np.isnan(error) else float(error) for error in errors],
            "scale_rad": timeline.error_scale_rad,
        }
    return {"caption": dict(caption), "view": view, "frame": frame}


def recent_pictures() -> Cache[bytes | None]:
    """Return an empty cache for recent pictures."""
    return Cache(MAX_CACHED_PICTURES, lambda _: 1)


class Pictures:
    """Pictures that child processes draw. Thread-safe.

    Args:
        settings: Settings with the directory in which they draw.
        pool: Child processes that draw.
    """

    def __init__(self, settings: Settings, pool: Pool) -> None:
        self._pool = pool
        self._scratch = Scratch(settings.motions_dir)
        self.recent = recent_pictures()

    def close(self) -> None:
        """End the children."""
        self._pool.close()

    def drawn(self, chain: Path, moment: Mapping[str, Any]) -> bytes:
        """Return the picture of the chain in a file, as PNG.

        Args:
            chain: File with the chain.
            moment: Result of ``moment_of``.

        Raises:
            OSError: If the file cannot be read, or the disk is full.
            InputError: If it holds no chain.
            ChildError: If the child crashed or exceeded a limit.
        """
        with self._scratch.directory() as place:
            shutil.copyfile(chain, place / CHAIN)
            (place / MOMENT_FILE).write_text(json.dumps(moment), encoding="utf-8")
            self._pool.call("picture", place)
            with open(place / PICTURE, "rb") as picture:
                # a faulty process must not fill the memory; 1200×630 pixels take 0.1 MB
                return picture.read(8 * 2**20)
