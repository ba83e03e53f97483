"""Movies of a timeline, drawn picture by picture without a simulation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from foldback.web.movies.encoding import find_ffmpeg, open_encoder
from foldback.web.movies.movie import Movie, MovieStop
from foldback.web.movies.renderer import MovieRenderer, Shot
from foldback.web.palette import SELECTED_RGB, error_colours, own_colours
from foldback.web.pictures.camera import few_points
from foldback.web.pictures.camera_path import CameraPath, camera_path
from foldback.web.pictures.lighting import TABLE_THEMES, THEMES
from foldback.web.pictures.meshes import stud_poses
from foldback.web.pictures.visible_modules import MAX_FULLY_DRAWN_MODULES, visible_modules
from foldback.web.timeline.view import Snapshot, TimelineView

Array = NDArray[np.float64]


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
        directory: Directory of the timeline.
        movie: Options of the movie.
        out: The file to write.
        on_table: True if the chain folds on a table, whose top is then the ground.
        backend: ``egl`` or ``osmesa``.
        progress: Called with the number of finished pictures.
        cancelled: Polled; returns True to cancel the movie.

    Returns:
        True if the movie is complete; False if it was cancelled.

    Raises:
        InputError: If the timeline does not have the frames.
        TimelineError: If there is no timeline, or it is damaged.
        NoGLError: If this backend cannot draw on this machine.
        NoEncoderError: If the format is MP4 and there is no ffmpeg.
        EncodingError: If the encoder fails.
    """
    if movie.format == "mp4":
        find_ffmpeg()  # before the drawing starts, which takes seconds
    timeline = TimelineView(directory)
    frames, stops = schedule(timeline, movie)
    with MovieRenderer(
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
        with open_encoder(movie, out) as add:
            for k, frame in enumerate(frames):
                if cancelled():
                    return False
                snapshot = timeline.snapshot(float(frame))
                picture = stage.draw(_shot(timeline, snapshot, path, k, stops[k]))
                add(_captioned(picture, stops[k], movie))
                progress(k + 1)
    return True


def schedule(timeline: TimelineView, movie: Movie) -> tuple[Array, list[MovieStop | None]]:
    """Return the frame of the timeline and the stop of the tour that each picture shows.

    The movie pauses at both ends and at each stop, and moves evenly in between.

    Returns:
        (K,) frames, fractional between two recorded ones, and K stops, None before the first.
    """
    phases = timeline.outline(1)["phases"]
    playback = next((p["from"] for p in phases if p["name"] == "playback"), 0)
    first, last = movie.frames(len(timeline), playback)
    stops = [stop for stop in movie.stops if min(first, last) <= stop.frame <= max(first, last)]
    if first > last:
        stops.reverse()
    # at most these seconds, and these fractions of the movie
    start, end = (
        min(seconds, share * movie.seconds) for seconds, share in ((0.4, 0.05), (1.2, 0.15))
    )
    reading = np.array([stop.reading_s for stop in stops])
    if stops:
        reading *= min(1.0, 0.6 * movie.seconds / reading.sum())
    at = np.array([first, *(stop.frame for stop in stops), last], np.float64)
    rests = np.array([start, *reading, end])
    # Pictures are shown from t = 0 to `shown`; the time besides the rests is divided by distance.
    shown_s = (movie.count - 1) / movie.fps
    moving = max(shown_s - float(rests.sum()), 1e-9)
    way = np.abs(np.diff(at, prepend=first)).cumsum()
    arrivals = moving * way / max(float(way[-1]), 1e-9) + rests.cumsum() - rests
    knots = np.column_stack([arrivals, arrivals + rests]).ravel()
    times = np.arange(movie.count) / movie.fps
    reached = np.searchsorted(arrivals[1:-1], times + 1e-9, side="right")
    return np.interp(times, knots, at.repeat(2)), [stops[k - 1] if k else None for k in reached]


def _captioned(
    picture: NDArray[np.uint8], stop: MovieStop | None, movie: Movie
) -> NDArray[np.uint8]:
    """Return a picture with the caption of a stop."""
    if stop is None:
        return picture
    from PIL import Image  # only movies with captions need it

    from foldback.web.pictures.caption import caption_strip

    strip = caption_strip(
        stop.caption, width=movie.width, height=movie.height, dark=movie.theme == "dark"
    )
    image = Image.fromarray(picture)
    image.paste(strip, (0, movie.height - strip.height), strip)
    return np.asarray(image)


def _shot(
    timeline: TimelineView,
    snapshot: Snapshot,
    path: CameraPath,
    k: int,
    stop: MovieStop | None,
) -> Shot:
    view = path.views[k]
    module, modules = timeline.chain.module, len(timeline.chain)
    drawn = visible_modules(snapshot.positions, module, target=view.target)
    poses = np.concatenate([snapshot.positions, snapshot.wxyzs], axis=1).astype(np.float64)
    colours = error_colours(snapshot.module_error_rad, timeline.error_scale_rad)
    if module.colours:
        unknown = np.isnan(snapshot.module_error_rad)
        colours[unknown] = own_colours(module, modules)[unknown]
    if stop is not None:
        colours[[module for module in stop.modules if module < len(colours)]] = SELECTED_RGB
    ends, end_turns = stud_poses(module, modules, poses[[0, -1], :3], poses[[0, -1], 3:])
    return Shot(
        numbers=drawn,
        positions=poses[drawn, :3],
        wxyzs=poses[drawn, 3:],
        colours=colours[drawn],
        ends=ends,
        end_turns=end_turns,
        view=view,
        ground=float(path.grounds[k]),
    )


def _path(timeline: TimelineView, movie: Movie, frames: Array) -> CameraPath:
    azimuth = movie.azimuth_deg
    lows = np.empty(len(frames))
    sampled_frames: list[Array] = []
    for k, frame in enumerate(frames):
        snapshot = timeline.snapshot(float(frame))
        positions = snapshot.positions[: snapshot.framed]
        lows[k] = positions[:, 2].min()
        sampled_frames.append(few_points(positions))
    return camera_path(
        sampled_frames,
        lows=lows,
        radius=timeline.chain.module.radius,
        aspect=movie.width / movie.height,
        fps=movie.fps,
        azimuth_rad=None if azimuth is None else float(np.deg2rad(azimuth)),
        elevation_rad=float(np.deg2rad(movie.elevation_deg)),
        turn_rad=float(np.deg2rad(movie.turn_deg)),
    )
