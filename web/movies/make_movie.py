"""Movies of a timeline, picture by picture, without a simulation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from web.movies.encoding import find_ffmpeg, open_encoder
from web.movies.movie import Movie
from web.movies.renderer import Shot, Stage
from web.pictures.camera import few_points
from web.pictures.camera_path import CameraPath, camera_path
from web.pictures.colours import error_colours
from web.pictures.lighting import TABLE_THEMES, THEMES
from web.pictures.visible import MAX_FULLY_DRAWN_MODULES, visible_modules
from web.timeline.view import Snapshot, TimelineView

Array = NDArray[np.float64]

STILL_S: Final = ((0.4, 0.05), (1.2, 0.15))
"""Time without motion at the beginning and at the end of a movie: (duration in s, largest fraction
of the movie's duration). Larger values leave less time for the motion. Chosen."""


def make_movie(
    directory: Path,
    movie: Movie,
    out: Path,
    *,
    on_table: bool = False,
    backend: str,
    progress: Callable[[int], None],
    cancelled: Callable[[], bool],
) -> bool:
    """Make a movie.

    Args:
        directory: The timeline's.
        movie: Options of the movie.
        out: The file to write.
        on_table: True if the chain folds on a table, whose top is the ground then.
        backend: ``egl`` or ``osmesa``.
        progress: Told the number of pictures that are done.
        cancelled: Asked often whether it is not wanted any more.

    Returns:
        Whether it is whole; False when it was cancelled.

    Raises:
        InputError: When the timeline does not have the frames.
        TimelineError: When there is no timeline, or it is damaged.
        NoGLError: When this backend cannot draw here.
        NoEncoderError: If the format is MP4 and there is no ffmpeg.
        EncodingError: When the encoder fails.
    """
    if movie.format == "mp4":
        find_ffmpeg()  # before the drawing starts, which takes seconds
    timeline = TimelineView(directory)
    frames = frame_numbers(timeline, movie)
    with Stage(
        timeline.chain.module,
        min(len(timeline.chain), MAX_FULLY_DRAWN_MODULES),
        width=movie.width,
        height=movie.height,
        theme=(TABLE_THEMES if on_table else THEMES)[movie.theme],
        backend=backend,
    ) as stage:
        path = _path(timeline, movie, frames)
        if on_table:
            path = replace(path, grounds=np.full(len(frames), timeline.chain.table_height))
        with open_encoder(movie, out) as encoder:
            for k, frame in enumerate(frames):
                if cancelled():
                    return False
                snapshot = timeline.snapshot(float(frame))
                encoder.add(stage.draw(_shot(timeline, snapshot, path, k)))
                progress(k + 1)
    return True


def frame_numbers(timeline: TimelineView, movie: Movie) -> Array:
    """Return (K,) the frame of the timeline that each picture shows, not whole between two.

    The movie rests a moment at both ends, so that the eye has time for them.
    """
    phases = timeline.outline(1)["phases"]
    playback = next((p["from"] for p in phases if p["name"] == "playback"), 0)
    first, last = movie.frames(len(timeline), playback)
    still = [min(seconds, share * movie.seconds) * movie.fps for seconds, share in STILL_S]
    moving = max(movie.count - 1 - sum(still), 1e-9)
    share = np.clip((np.arange(movie.count) - still[0]) / moving, 0.0, 1.0)
    return np.asarray(first + (last - first) * share, np.float64)


def _shot(timeline: TimelineView, snapshot: Snapshot, path: CameraPath, k: int) -> Shot:
    view = path.views[k]
    drawn = visible_modules(snapshot.positions, timeline.chain.module, target=view.target)
    poses = np.concatenate([snapshot.positions, snapshot.wxyzs], axis=1).astype(np.float64)
    return Shot(
        positions=poses[drawn, :3],
        wxyzs=poses[drawn, 3:],
        colours=error_colours(snapshot.module_error_rad[drawn], timeline.error_scale_rad),
        ends=poses[[0, -1]],
        view=view,
        ground=float(path.grounds[k]),
    )


def _path(timeline: TimelineView, movie: Movie, frames: Array) -> CameraPath:
    azimuth = movie.azimuth_deg
    lows = np.empty(len(frames))
    some: list[Array] = []
    for k, frame in enumerate(frames):
        snapshot = timeline.snapshot(float(frame))
        positions = snapshot.positions[: snapshot.framed]
        lows[k] = positions[:, 2].min()
        some.append(few_points(positions))
    return camera_path(
        some,
        lows=lows,
        radius=timeline.chain.module.radius,
        aspect=movie.width / movie.height,
        fps=movie.fps,
        azimuth_rad=None if azimuth is None else float(np.deg2rad(azimuth)),
        elevation_rad=float(np.deg2rad(movie.elevation_deg)),
        turn_rad=float(np.deg2rad(movie.turn_deg)),
    )
