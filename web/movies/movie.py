"""Movie: options of a movie, and their bounds."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, Literal, Self

from foldback.planner.errors import InputError
from foldback.planner.parameters.option import key_of_options
from foldback.planner.plan.tour import Tour

Format = Literal["mp4", "gif"]
Theme = Literal["light", "dark"]
FORMATS: Final = ("mp4", "gif")
MOVIE_THEMES: Final = ("light", "dark")
DEFAULT_OPTIONS: Final[dict[str, dict[str, float]]] = {
    "mp4": {"width": 1280, "height": 720, "fps": 30, "seconds": 10.0},
    "gif": {"width": 640, "height": 360, "fps": 15, "seconds": 6.0},
}
"""Default width and height in pixels, frames per second and duration in s of a movie, by file
format."""
MAX_SIDES_PX: Final[dict[str, tuple[int, int]]] = {"mp4": (1920, 1080), "gif": (960, 720)}
"""Maximum length of a movie's longer and shorter side by file format, in pixels, upright or not."""
MAX_FPS: Final[dict[str, int]] = {"mp4": 60, "gif": 25}
"""Maximum number of a movie's frames per second by file format."""
MAX_MOVIE_S: Final[dict[str, float]] = {"mp4": 60.0, "gif": 20.0}
"""Maximum duration of a movie by file format, in s."""
MAX_TURN_DEG: Final = 720.0
"""Maximum angle by which a movie's camera may orbit around the chain, in degrees in either
direction."""


@dataclass(frozen=True, slots=True)
class MovieStop:
    """A stop of a tour in a movie.

    Attributes:
        frame: Frame of the timeline, from 0.
        caption: Text that is shown from this frame on.
        modules: Modules that are highlighted meanwhile, from 0.
    """

    frame: int
    caption: str
    modules: tuple[int, ...] = ()

    @property
    def reading_s(self) -> float:
        """Time that it takes to read the caption, s."""
        return max(1.5, len(self.caption) / 17.0)  # the usual limit for subtitles


@dataclass(frozen=True, slots=True, kw_only=True)
class Movie:
    """Options of a movie.

    Attributes:
        format: ``mp4``, or ``gif``.
        width: Width of a picture, pixels; even.
        height: Height of a picture, pixels; even.
        fps: Pictures per second.
        seconds: Duration, s.
        azimuth_deg: Azimuth of the camera at the end, degrees; chosen from the shape when None.
        elevation_deg: Elevation of the camera above the horizon, degrees.
        turn_deg: Angle by which the camera orbits around the chain, degrees.
        theme: ``light``, or ``dark``.
        first_frame: First frame of the timeline; the playback's first one when None.
        last_frame: Last frame of the timeline; its last one when None. If it is before the first
            frame, the movie runs backwards.
        stops: Stops of a tour, in the order of their frames; the movie pauses at each.
    """

    format: Format = "mp4"
    width: int = 1280
    height: int = 720
    fps: int = 30
    seconds: float = 10.0
    azimuth_deg: float | None = None
    elevation_deg: float = 24.0
    turn_deg: float = 30.0
    theme: Theme = "light"
    first_frame: int | None = None
    last_frame: int | None = None
    stops: tuple[MovieStop, ...] = ()

    @classmethod
    def of(cls, options: Mapping[str, Any], tour: Mapping[str, Any] | None = None) -> Self:
        """Return a movie with the given options and the defaults of its format.

        Args:
            options: Fields of the movie.
            tour: Tour whose captions it shows. The default duration leaves time to read them.

        Raises:
            InputError: If an option is outside its bounds.
        """
        set_options = {name: value for name, value in options.items() if value is not None}
        plain = DEFAULT_OPTIONS.get(str(set_options.get("format", "mp4")), DEFAULT_OPTIONS["mp4"])
        set_options["stops"] = tuple(
            MovieStop(stop["frame"], stop["caption"], tuple(stop["modules"]))
            for stop in set_options.get("stops", ())
        )
        movie = cls(**{**plain, **set_options})  # pyright: ignore[reportArgumentType]
        if tour is not None:
            movie = replace(movie, stops=_stops(Tour.from_dict(tour)))
            if "seconds" not in set_options:
                needed = movie.seconds + sum(stop.reading_s for stop in movie.stops)
                longest = MAX_MOVIE_S.get(movie.format, needed)
                movie = replace(movie, seconds=min(round(needed), longest))
        movie.check()
        return movie

    @property
    def count(self) -> int:
        """Number of pictures."""
        return max(1, round(self.seconds * self.fps))

    @property
    def key(self) -> str:
        """Key of the movie, equal for equal options."""
        return key_of_options(self)

    def check(self) -> None:
        """Check the bounds.

        Raises:
            InputError: If an option is outside its bounds.
        """
        _one_of("format", self.format, FORMATS)
        _one_of("theme", self.theme, MOVIE_THEMES)
        longer, shorter = MAX_SIDES_PX[self.format]
        for name, value in (("width", self.width), ("height", self.height)):
            _within(name, value, 64, longer, " pixels")
            if value % 2:
                raise InputError(
                    "bad-movie",
                    f"got {value} pixels, expected an even number of pixels.",
                    where=name,
                )
        if min(self.width, self.height) > shorter:
            raise InputError(
                "bad-movie",
                f"got {self.width}×{self.height} pixels, expected at most {longer}×{shorter} "
                f"(or {shorter}×{longer}) for {self.format.upper()}.",
                where="height",
            )
        _within("fps", self.fps, 1, MAX_FPS[self.format], " pictures per second")
        _within("seconds", self.seconds, 0.1, MAX_MOVIE_S[self.format], " s")
        if self.azimuth_deg is not None:
            _within("azimuth_deg", self.azimuth_deg, -360, 360, "°")
        _within("elevation_deg", self.elevation_deg, -10.0, 85.0, "°")
        _within("turn_deg", self.turn_deg, -MAX_TURN_DEG, MAX_TURN_DEG, "°")

    def frames(self, total: int, playback: int) -> tuple[int, int]:
        """Return the first and the last frame of a timeline that it shows.

        Args:
            total: Number of frames of the timeline.
            playback: First frame of the playback.

        Raises:
            InputError: If the timeline does not have these frames.
        """
        first = playback if self.first_frame is None else self.first_frame
        last = total - 1 if self.last_frame is None else self.last_frame
        for name, frame in (("first_frame", first), ("last_frame", last)):
            _within(name, frame, 0, total - 1, f": the timeline has {total} frames, counted from 0")
        return first, last


def _stops(tour: Tour) -> tuple[MovieStop, ...]:
    """Return the stops of a tour in the order of their frames; tours count from 1."""
    stops = (
        MovieStop(stop.frame - 1, stop.caption, tuple(module - 1 for module in stop.modules))
        for stop in tour.stops
    )
    return tuple(sorted(stops, key=lambda stop: stop.frame))


def _one_of(name: str, value: object, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise InputError(
            "bad-movie", f"got {str(value)[:40]!r}, expected {' or '.join(choices)}.", where=name
        )


def _within(name: str, value: float, low: float, high: float, unit: str) -> None:
    if not low <= value <= high:
        # An integer may be too large for the conversion to a float.
        readable = -sys.float_info.max < value < sys.float_info.max
        value_text = f"{value:g}" if readable else "a number that is too large or undefined"
        raise InputError(
            "bad-movie", f"got {value_text}, expected {low:g} to {high:g}{unit}.", where=name
        )
