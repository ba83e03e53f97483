"""Pictures: the film and stills of a fold that are stored with its figures.

``batch`` is a film that pages play, ``chain.json`` its chain. ``still.webp`` shows the chain folded
or where it fails; ``straight.webp`` and ``strip.webp`` exist for some folds.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from bench.reproduction.still import STILL_PX, still
from foldback.planner.chain.chain_attributes import chain_attributes
from foldback.planner.storage.files import write_json
from foldback.web.palette import STALLED_RGB, error_colours
from foldback.web.timeline.frame_batch import chosen
from foldback.web.timeline.view import Snapshot, TimelineView

Ints = NDArray[np.int64]
FRAMES_PER_PHASE: Final = 120
"""Number of frames of each phase (explosion, folding) in the stored film of a fold, spread evenly
over the rotation of the hinges."""
MAX_FILM_BYTES: Final = 250_000
"""Maximum size of the stored film of one fold, in bytes; frames are omitted from a larger film
until it fits."""
FRAMES_REDUCTION: Final = 0.8
"""Factor by which the number of frames of a film is multiplied, again and again, until its file is
small enough."""
STILL_RADIUS_PITCH: Final = 4.0
"""Minimum radius around the modules at which a fold fails that the picture of this moment shows, in
pitches."""
STRIP_GRID: Final = (6, 2)
"""Columns and rows of a strip: explosion above, fold below, as in Figure 3."""
STRIP_PICTURE_PX: Final = (240, 180)
"""Width and height of a picture in a strip, px."""
WEBP_QUALITY: Final = 82
"""Quality of the stored pictures of folds, from 0 to 100 (WebP)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """Moment of a failure: its modules, and its frame, which may be a fraction between two."""

    frame: float
    modules: tuple[int, ...]


def keep_pictures(
    film: TimelineView, folder: Path, *, moment: Moment | None, strip: bool, straight: bool
) -> tuple[int, int | None]:
    """Write the film and stills of a fold.

    Args:
        film: Timeline of the whole fold.
        folder: Directory for the files; an existing one is replaced.
        moment: Moment of the failure; None if it does not fail.
        strip: True to write twelve small pictures.
        straight: True to write a picture of the straight chain.

    Returns:
        Number of frames of the stored film, and the number of the one that shows the moment.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    at = None if moment is None else round(moment.frame)
    count = FRAMES_PER_PHASE
    while True:
        frames = _spread(film, count, at)
        batch = chosen(film, frames)
        if len(batch) <= MAX_FILM_BYTES:
            break
        count = round(FRAMES_REDUCTION * count)
    (folder / "batch").write_bytes(batch)
    write_json(folder / "chain.json", chain_attributes(film.chain))
    snapshot = film.snapshot(len(film) - 1 if moment is None else moment.frame)
    _save(_still(film, snapshot, moment), folder / "still.webp")
    if straight:
        last = int(_phases(film)[0][-1])
        _save(_still(film, film.snapshot(last)), folder / "straight.webp")
    if strip:
        _save(_strip(film), folder / "strip.webp")
    return len(frames), None if at is None else int(np.searchsorted(frames, at))


def _phases(film: TimelineView) -> list[Ints]:
    """Return the frame numbers of each phase."""
    return [np.arange(phase["from"], phase["to"]) for phase in film.outline()["phases"]]


def _spread(film: TimelineView, count: int, also: int | None) -> Ints:
    """Return frame numbers: ``count`` from each phase, and one required frame."""
    parts = [_evenly(film, frames, count) for frames in _phases(film)]
    if also is not None:
        parts.append(np.array([also]))
    return np.unique(np.concatenate(parts))


def _evenly(film: TimelineView, frames: Ints, count: int) -> Ints:
    """Choose frames with equal rotation of the hinges between them; include first and last."""
    motion = film.motion(int(frames[0]), int(frames[-1]) + 1)
    angles = motion.angles(film.chain)
    turned = np.sqrt((np.diff(angles, axis=0) ** 2).mean(axis=1))
    way = np.concatenate([[0.0], np.cumsum(turned)])
    places = np.searchsorted(way, np.linspace(0.0, way[-1], count))
    return frames[
        np.unique(np.concatenate([[0], places.clip(0, len(frames) - 1), [len(frames) - 1]]))
    ]


def _still(
    film: TimelineView,
    snapshot: Snapshot,
    moment: Moment | None = None,
    size: tuple[int, int] = STILL_PX,
) -> Image.Image:
    colours = error_colours(snapshot.module_error_rad, film.error_scale_rad)
    around = None
    if moment is not None and moment.modules:
        colours[list(moment.modules)] = STALLED_RGB
        at = snapshot.positions[list(moment.modules)]
        distance = np.linalg.norm(snapshot.positions - at.mean(axis=0), axis=1)
        around = snapshot.positions[
            distance <= max(STILL_RADIUS_PITCH, float(np.ptp(at, axis=0).max()))
        ]
    return still(
        film.chain.module, snapshot.positions, snapshot.wxyzs, colours, size=size, around=around
    )


def _strip(film: TimelineView) -> Image.Image:
    columns, rows = STRIP_GRID
    width, height = STRIP_PICTURE_PX
    sheet = Image.new("RGBA", (columns * width, rows * height))
    for row, frames in enumerate(_phases(film)[:rows]):
        for column, frame in enumerate(_evenly_few(film, frames, columns)):
            picture = _still(film, film.snapshot(int(frame)), size=STRIP_PICTURE_PX)
            sheet.paste(picture, (column * width, row * height))
    return sheet


def _evenly_few(film: TimelineView, frames: Ints, count: int) -> Ints:
    result = _evenly(film, frames, FRAMES_PER_PHASE)
    return result[np.rint(np.linspace(0, len(result) - 1, count)).astype(np.int64)]


def _save(picture: Image.Image, path: Path) -> None:
    picture.save(path, "WEBP", quality=WEBP_QUALITY, method=6)
