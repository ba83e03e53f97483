"""Pictures: what is kept of a fold to look at, beside its figures.

``batch`` is a film that pages play, ``chain.json`` its chain; ``still.webp`` shows it folded or
where it fails, of some ``straight.webp`` and ``strip.webp`` more.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from planner.files import write_json
from planner.motion.timeline import chain_attributes
from web.pictures.colours import STALLED_RGB, error_colours
from web.pictures.still import STILL_PX, still
from web.timeline.frame_batch import chosen
from web.timeline.view import Snapshot, TimelineView

Ints = NDArray[np.int64]
FRAMES: Final = 120
"""Of each phase, spread evenly over how far its hinges turn."""
LARGEST_BATCH: Final = 250_000
"""Bytes; longer chains have fewer frames."""
FEWER: Final = 0.8
AROUND: Final = 4.0
"""Pitches around the modules that overlap which a still shows."""
STRIP: Final = (6, 2)
"""Pictures in a row, and rows: above the way out, below the way back, as in Figure 3."""
STRIP_SIZE: Final = (240, 180)
QUALITY: Final = 82


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """Where a fold fails: a frame of its timeline, which may lie between two, and modules."""

    frame: float
    modules: tuple[int, ...]


def keep_pictures(
    film: TimelineView, folder: Path, *, moment: Moment | None, strip: bool, straight: bool
) -> tuple[int, int | None]:
    """Writes film and stills of a fold.

    Args:
        film: The whole fold.
        folder: Where they go; made anew.
        moment: Where it fails; None when it does not.
        strip: Whether there are twelve small pictures.
        straight: Whether there is one of the chain while it is straight.

    Returns:
        The frames of the film that is kept, and which of them shows the moment.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    at = None if moment is None else round(moment.frame)
    count = FRAMES
    while True:
        frames = _spread(film, count, at)
        batch = chosen(film, frames)
        if len(batch) <= LARGEST_BATCH:
            break
        count = round(FEWER * count)
    (folder / "batch").write_bytes(batch)
    write_json(folder / "chain.json", chain_attributes(film.chain))
    shown = film.snapshot(len(film) - 1 if moment is None else moment.frame)
    _save(_still(film, shown, moment), folder / "still.webp")
    if straight:
        last = int(_phases(film)[0][-1])
        _save(_still(film, film.snapshot(last)), folder / "straight.webp")
    if strip:
        _save(_strip(film), folder / "strip.webp")
    return len(frames), None if at is None else int(np.searchsorted(frames, at))


def _phases(film: TimelineView) -> list[Ints]:
    """The frames of each phase."""
    return [np.arange(phase["from"], phase["to"]) for phase in film.outline()["phases"]]


def _spread(film: TimelineView, count: int, also: int | None) -> Ints:
    """So many frames of each phase, and one that must be among them."""
    parts = [_evenly(film, frames, count) for frames in _phases(film)]
    if also is not None:
        parts.append(np.array([also]))
    return np.unique(np.concatenate(parts))


def _evenly(film: TimelineView, frames: Ints, count: int) -> Ints:
    """So many of some frames, the same turn of hinges apart; the first and the last are there."""
    angles = film.frames(int(frames[0]), int(frames[-1]) + 1).joint_angles_rad
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
        away = np.linalg.norm(snapshot.positions - at.mean(axis=0), axis=1)
        around = snapshot.positions[away <= max(AROUND, float(np.ptp(at, axis=0).max()))]
    return still(
        film.chain.module, snapshot.positions, snapshot.wxyzs, colours, size=size, around=around
    )


def _strip(film: TimelineView) -> Image.Image:
    columns, rows = STRIP
    width, height = STRIP_SIZE
    sheet = Image.new("RGBA", (columns * width, rows * height))
    for row, frames in enumerate(_phases(film)[:rows]):
        for column, frame in enumerate(_evenly_few(film, frames, columns)):
            picture = _still(film, film.snapshot(int(frame)), size=STRIP_SIZE)
            sheet.paste(picture, (column * width, row * height))
    return sheet


def _evenly_few(film: TimelineView, frames: Ints, count: int) -> Ints:
    found = _evenly(film, frames, FRAMES)
    return found[np.rint(np.linspace(0, len(found) - 1, count)).astype(np.int64)]


def _save(picture: Image.Image, path: Path) -> None:
    picture.save(path, "WEBP", quality=QUALITY, method=6)
