import json
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from PIL import Image

from foldback.planner.chain.chain import Chain
from foldback.web.movies.encoding import (
    EncodingError,
    NoEncoderError,
    find_ffmpeg,
    formats,
    open_encoder,
)
from foldback.web.movies.make_movie import make_movie, schedule
from foldback.web.movies.movie import Movie
from foldback.web.movies.renderer import MovieRenderer, NoGLError
from foldback.web.pictures.caption import caption_strip
from foldback.web.pictures.lighting import TABLE_THEMES, THEMES
from foldback.web.timeline.view import TimelineView
from tests.refusal import refused

SMALL = {"width": 320, "height": 180, "seconds": 0.8, "fps": 10}


Film = Callable[..., tuple[str, np.ndarray]]


@pytest.fixture
def film(timeline_path: Path, tmp_path: Path, backend: str) -> Film:
    """Function that makes a movie, and returns what ``read`` finds in it."""

    def make(movie: Movie, **options: Any) -> tuple[str, np.ndarray]:
        out, done = tmp_path / f"fold.{movie.format}", list[int]()
        calls = {"progress": done.append, "cancelled": lambda: False}
        assert make_movie(timeline_path, movie, out, backend=backend, **calls, **options)
        assert done == list(range(1, movie.count + 1))
        assert [path.name for path in tmp_path.iterdir()] == [out.name]
        return read(out)

    return make


def read(path: Path) -> tuple[str, np.ndarray]:
    """Return ffmpeg's description of a movie's picture stream, and (K, H, W, 3) sRGB bytes."""
    command = [find_ffmpeg(), "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24"]
    process = subprocess.run(
        [*command, "-fps_mode", "passthrough", "-"], capture_output=True, check=True
    )
    about = next(line for line in process.stderr.decode().splitlines() if "Video:" in line)
    size = re.search(r", (\d+)x(\d+)", about)
    assert size, about
    shape = (-1, int(size[2]), int(size[1]), 3)
    return about, np.frombuffer(process.stdout, np.uint8).reshape(shape)


@pytest.mark.parametrize("kind", ["mp4", "gif"])
def test_movie_has_its_format_size_ground_and_colours(
    film: Film, tmp_path: Path, kind: str
) -> None:
    about, pictures = film(Movie.of({**SMALL, "format": kind}))
    assert pictures.shape == (8, 180, 320, 3)
    assert " 10 fps" in about
    if kind == "mp4":
        assert "h264" in about and "yuv420p(tv, bt709" in about
        data = (tmp_path / "fold.mp4").read_bytes()
        assert data.index(b"moov") < data.index(b"mdat")  # it plays while it is loading
    ground = np.array(THEMES["light"].ground)
    corners = pictures[:, [2, 2, -3, -3], [2, -3, 2, -3]].astype(int)
    assert np.abs(corners - ground).max() <= 12
    modules = (np.abs(pictures.astype(int) - ground).max(axis=-1) > 60).mean(axis=(1, 2))
    assert (modules > 0.005).all()
    assert modules[-1] > modules[0]  # the camera approaches as the chain gets shorter
    assert np.abs(np.diff(pictures[:, ::4, ::4].astype(int), axis=0)).max(axis=(1, 2, 3))[3] > 40
    if kind == "mp4":  # the palette has few reds
        # The joint with the error turns red.
        over = pictures[[0, -1], ..., 0].astype(int) - pictures[[0, -1], ..., 1]
        bright_pixels, count = (over > 70).sum(axis=(1, 2))
        assert bright_pixels == 0 < 10 < count


def test_ground_is_that_of_the_theme_or_a_table(film: Film) -> None:
    movie = Movie.of({**SMALL, "theme": "dark", "seconds": 0.1})
    for on_table, themes in ((False, THEMES), (True, TABLE_THEMES)):
        picture = film(movie, on_table=on_table)[1][0]
        assert picture[-2, 2] == pytest.approx(themes["dark"].ground, abs=5)
    assert picture.max() > picture[-2, 2].max()


def test_frames_rest_at_both_ends_and_go_from_straight_to_folded(timeline_path: Path) -> None:
    film = TimelineView(timeline_path)
    numbers, _ = schedule(film, Movie.of({"seconds": 10}))
    assert (numbers[0], numbers[-1]) == (100, 199)  # the playback, as it has 100 of 200 frames
    assert (numbers == 100).sum() > 8 and (numbers == 199).sum() > 30
    steps = np.diff(numbers[20:-45])
    assert steps == pytest.approx(steps[0])
    backwards, _ = schedule(film, Movie.of({"first_frame": 50, "last_frame": 0}))
    assert (backwards[0], backwards[-1]) == (50, 0)
    assert list(schedule(film, Movie.of({"seconds": 0.1, "fps": 1}))[0]) == [100]


TOUR = {
    "format": "foldback-tour/1",
    "title": "Wrench",
    "stops": [
        {"caption": "Done.", "frame": 200, "modules": [1]},
        {"caption": "Not in this part.", "frame": 3},
        {"caption": "The tightest place – 4.9 % of a width in Brücke. " * 2, "frame": 151},
    ],
}


def test_movie_of_a_tour_rests_at_its_stops_for_as_long_as_reading_takes(
    timeline_path: Path,
) -> None:
    movie = Movie.of({}, TOUR)
    assert [stop.frame for stop in movie.stops] == [2, 150, 199]
    assert movie.seconds > 10 + len(TOUR["stops"][2]["caption"]) / 17
    frames, timeline_view = schedule(TimelineView(timeline_path), movie)
    rests = [
        sum(stop is not None and stop.frame == f for stop in timeline_view) for f in (2, 150, 199)
    ]
    assert rests[0] == 0 and rests[1] > rests[2] > 1.5 * movie.fps
    assert (frames == 150).sum() >= movie.stops[1].reading_s * movie.fps - 1
    assert (np.diff(frames) >= 0).all() and (frames[0], frames[-1]) == (100, 199)
    hurried, _ = schedule(TimelineView(timeline_path), Movie.of({"seconds": 3}, TOUR))
    assert (np.diff(hurried) > 0).mean() > 0.15  # it still moves


def test_movie_shows_captions_and_highlights_their_modules(film: Film) -> None:
    options = {**SMALL, "first_frame": 198, "seconds": 0.2}
    movies = (Movie.of(options), Movie.of(options, TOUR))
    without, captioned = (film(movie)[1][-1].astype(int) for movie in movies)
    strip = caption_strip("Done.", width=320, height=180, dark=False)
    changed = np.abs(captioned - without).max(axis=2) > 60
    assert changed[-strip.height :].sum() > 20  # letters
    blue = captioned[..., 2] - captioned[..., 0] > 60
    assert blue[: -strip.height].sum() > 10 and not (without[..., 2] - without[..., 0] > 60).any()


def test_captions_fit_the_picture_and_leave_out_unknown_letters() -> None:
    short = caption_strip("Brücke × 2", width=320, height=180, dark=True)
    assert short.height < 40
    for text in ("word " * 60, "x" * 300):
        assert caption_strip(text, width=320, height=180, dark=True).height <= 75
    with_unknown = caption_strip("Brücke 日本 × 2", width=320, height=180, dark=True)
    assert with_unknown.tobytes() == short.tobytes()


WRONG: tuple[dict[str, Any], ...] = (
    *({"width": 641}, {"width": 1922}, {"height": 62}, {"fps": 61}, {"fps": 0}, {"seconds": 61}),
    *(
        {"seconds": float("nan")},
        {"fps": 10**400},
        {"elevation_deg": 90},
        {"azimuth_deg": float("inf")},
    ),
    *({"turn_deg": -1e9}, {"theme": "pink"}, {"format": "avi"}),
    *({"width": 1920, "height": 1920}, {"format": "gif", "width": 1280}),
    *({"format": "gif", "fps": 30}, {"format": "gif", "seconds": 30}),
)
"""Options of movies, the last of which is wrong."""


def test_wrong_options_and_frames_are_refused_by_name(timeline_path: Path) -> None:
    for options in WRONG:
        with refused("bad-movie", [*options][-1], match="expected"):
            Movie.of(options)
    with refused("bad-movie", "last_frame", match="200 frames"):
        schedule(TimelineView(timeline_path), Movie.of({"last_frame": 200}))


def test_formats_have_default_sizes_and_the_same_options_the_same_key() -> None:
    assert (Movie.of({}).width, Movie.of({}).fps) == (1280, 30)
    gif = Movie.of({"format": "gif"})
    assert (gif.width, gif.fps) == (640, 15)
    assert Movie.of({"width": 1080, "height": 1920}).count == 300
    movie = Movie.of({"seconds": 10.0})
    assert movie.key == Movie.of({"width": None, "fps": 30}).key
    assert movie.key != replace(movie, theme="dark").key
    assert Movie.of(json.loads(json.dumps({"turn_deg": 30.0}))).key == movie.key


def test_missing_opengl_is_an_error(chain: Chain) -> None:
    with pytest.raises(NoGLError, match="glide"):
        MovieRenderer(
            chain.module, len(chain), width=64, height=64, theme=THEMES["light"], backend="glide"
        )


def test_failed_encoder_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "ffmpeg"
    program.write_text("#!/bin/sh\necho no space left >&2\nexit 3\n")
    program.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(program))
    with (
        pytest.raises(EncodingError, match="exit code 3: no space left"),
        open_encoder(Movie.of(SMALL), tmp_path / "missing.mp4") as add,
    ):
        for _ in range(50):
            add(np.zeros((180, 320, 3), np.uint8))
    assert list(tmp_path.iterdir()) == [program]


def test_encoder_ends_with_its_input_after_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused_by_the_sandbox(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(subprocess.Popen, "send_signal", refused_by_the_sandbox)
    movie = Movie.of(SMALL)
    with pytest.raises(ZeroDivisionError), open_encoder(movie, tmp_path / "a.mp4") as add:
        add(np.zeros((movie.height, movie.width, 3), np.uint8))
        raise ZeroDivisionError
    assert not [child for child in psutil.Process().children() if "ffmpeg" in child.name()]


@pytest.fixture
def without_ffmpeg(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    monkeypatch.delenv("IMAGEIO_FFMPEG_EXE", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    return monkeypatch


def test_ffmpeg_of_the_setting_comes_before_path_and_extra(
    without_ffmpeg: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert "imageio_ffmpeg" in find_ffmpeg()
    assert formats() == ("mp4", "gif")
    on_path = tmp_path / "ffmpeg"
    on_path.write_text("#!/bin/sh\n")
    on_path.chmod(0o755)
    assert find_ffmpeg() == str(on_path)
    assert formats() == ("gif",)  # that program has no encoder
    without_ffmpeg.setenv("IMAGEIO_FFMPEG_EXE", "/opt/other")
    assert find_ffmpeg() == "/opt/other"
    assert formats() == ("gif",)
    with pytest.raises(EncodingError, match="/opt/other cannot be started: No such file"):
        open_encoder(Movie.of(SMALL), tmp_path / "fold.mp4").__enter__()
    assert list(tmp_path.iterdir()) == [on_path]


def test_gif_without_ffmpeg_has_its_pictures_colours_and_times(
    without_ffmpeg: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    without_ffmpeg.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(NoEncoderError, match="no ffmpeg is on PATH"):
        open_encoder(Movie.of(SMALL), tmp_path / "fold.mp4").__enter__()
    movie = Movie.of({"format": "gif", "width": 66, "height": 64, "seconds": 2.0, "fps": 15})
    ramp = np.add.outer(np.arange(64), np.arange(66)).astype(np.uint8)
    stacks = [np.stack([ramp, ramp + 2 * k, 255 - ramp], axis=-1) for k in range(movie.count)]
    with open_encoder(movie, tmp_path / "fold.gif") as add:
        for picture in stacks:
            add(picture)
    with Image.open(tmp_path / "fold.gif") as gif:
        assert gif.info["loop"] == 0
        ends = [0]
        for k in range(movie.count):
            gif.seek(k)
            ends.append(ends[-1] + gif.info["duration"])
            gif_pixels = np.asarray(gif.convert("RGB")).astype(int)
            assert np.abs(gif_pixels - stacks[k]).mean() < 6
        assert ends == pytest.approx(1000 / 15 * np.arange(movie.count + 1), abs=5.01)
        with pytest.raises(EOFError):
            gif.seek(movie.count)
