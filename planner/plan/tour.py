"""Tours: a list of stops in a fold, each a view of one frame with a caption: docs/tours.md."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, Final, cast

from foldback.planner.chain.display_names import clean_name
from foldback.planner.errors import unexpected

TOUR_FORMAT: Final = "foldback-tour/1"
_bad: Final = partial(unexpected, "bad-tour")
MAX_STOPS: Final = 50
"""Maximum number of stops of a tour (a guided sequence of captioned frames of a fold, which a page
shows one after the other); a tour with more is refused."""
MAX_CAPTION: Final = 300
"""Maximum number of characters of the caption of one stop of a tour (a guided sequence of captioned
frames of a fold); a tour with a longer one is refused."""
MAX_TITLE: Final = 200
"""Maximum number of characters of the title of a tour (a guided sequence of captioned frames of a
fold); a tour with a longer title is refused."""
MAX_STOP_MODULES: Final = 8
"""Maximum number of modules that one stop of a tour (a guided sequence of captioned frames of a
fold) highlights; a tour with more is refused."""
MAX_NUMBER: Final = 999_999_999
"""Largest number of a frame or module that is accepted in a tour (a guided sequence of captioned
frames of a fold) if the fold's own size is not known; a larger one is refused. Nine digits, as many
as the address of a fold's page may hold."""
DECIMAL: Final = r"-?\d{1,3}(?:\.\d{1,4})?"
CAMERA_PATTERN: Final = rf"(?:{DECIMAL})?,(?:{DECIMAL})?,{DECIMAL}(?:,{DECIMAL},{DECIMAL})?"
"""Matches a camera in an address: azimuth and elevation in degrees (or empty), distance as a
multiple of the default one and, if the camera does not follow the chain, its horizontal and
vertical offset."""
COLOUR_PATTERN: Final = r"[a-z_-]{1,20}"
"""Matches names of quantities that colours show; pages ignore names that they do not know."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stop:
    """One stop of a tour. Frames and modules count from 1, as in the address of a page.

    Attributes:
        caption: Text of the stop, without markup.
        frame: Frame of the timeline.
        modules: Modules that are highlighted; without a camera, the view turns to them.
        first: First frame of a loop that plays at the stop; with ``last``, or neither.
        last: Last frame of that loop.
        camera: Camera as in an address; None for the default one.
        follow: False if the camera stays where it is while the chain moves.
        colour: Quantity that colours show; None for the position in the chain.
        path: True if modules are transparent and show the path of the chain.
    """

    caption: str
    frame: int
    modules: tuple[int, ...] = ()
    first: int | None = None
    last: int | None = None
    camera: str | None = None
    follow: bool = True
    colour: str | None = None
    path: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values, without those that are the default."""
        values: dict[str, Any] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if value != field.default:
                values[_KEYS.get(field.name, field.name)] = (
                    list(value) if isinstance(value, tuple) else value
                )
        return values


_KEYS: Final = {"first": "from", "last": "to"}
_NAMES: Final = {_KEYS.get(field.name, field.name): field.name for field in fields(Stop)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Tour:
    """A tour of a fold.

    Attributes:
        title: Its title.
        stops: Its stops in order, 1 to ``MAX_STOPS``.
    """

    title: str
    stops: tuple[Stop, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        return {
            "format": TOUR_FORMAT,
            "title": self.title,
            "stops": [stop.as_dict() for stop in self.stops],
        }

    @classmethod
    def from_dict(
        cls, values: object, *, frames: int = MAX_NUMBER, modules: int = MAX_NUMBER
    ) -> Tour:
        """Build a tour from JSON values.

        Args:
            values: The values.
            frames: Number of frames of the fold that it is for.
            modules: Number of its modules.

        Raises:
            InputError: ``bad-tour``: saying what was found, what is expected, and where.
        """
        tour = _mapping(values, {"format", "title", "stops"}, "tour")
        if tour.get("format") != TOUR_FORMAT:
            raise _bad("format", tour.get("format"), repr(TOUR_FORMAT))
        stops = tour.get("stops")
        if not isinstance(stops, list) or not 1 <= len(cast("list[object]", stops)) <= MAX_STOPS:
            actual = (
                f"{len(cast('list[object]', stops))} stops" if isinstance(stops, list) else stops
            )
            raise _bad("stops", actual, f"a list of 1 to {MAX_STOPS} stops")
        return cls(
            title=_text("title", tour.get("title"), MAX_TITLE),
            stops=tuple(
                _stop(stop, f"stop {k}", frames, modules)
                for k, stop in enumerate(cast("list[object]", stops), 1)
            ),
        )


def _stop(values: object, place: str, frames: int, modules: int) -> Stop:
    stop = _mapping(values, set(_NAMES), place)
    fields = {_NAMES[key]: value for key, value in stop.items() if value is not None}
    checked: dict[str, Any] = {
        "caption": _text(f"{place}, caption", fields.get("caption"), MAX_CAPTION),
        "frame": _number(f"{place}, frame", fields.get("frame"), frames),
    }
    if ("first" in fields) != ("last" in fields):
        raise _bad(f"{place}, from", stop.get("from"), "both 'from' and 'to', or neither")
    if "first" in fields:
        checked["last"] = _number(f"{place}, to", fields["last"], frames)
        checked["first"] = _number(f"{place}, from", fields["first"], frames)
        if checked["first"] >= checked["last"]:
            raise _bad(f"{place}, from", fields["first"], f"a frame before {fields['last']}")
    if "modules" in fields:
        checked["modules"] = _modules(f"{place}, modules", fields["modules"], modules)
    for name, pattern, like in _TEXTS:
        if name in fields:
            if not isinstance(fields[name], str) or not re.fullmatch(
                pattern, fields[name], re.ASCII
            ):
                raise _bad(f"{place}, {name}", fields[name], like)
            checked[name] = fields[name]
    for name in ("follow", "path"):
        if name in fields:
            if not isinstance(fields[name], bool):
                raise _bad(f"{place}, {name}", fields[name], "true or false")
            checked[name] = fields[name]
    return Stop(**checked)


_TEXTS: Final = (
    (
        "camera",
        CAMERA_PATTERN,
        "a camera position as in the address of a fold's page, such as '-62.5,24,1.2'",
    ),
    ("colour", COLOUR_PATTERN, "the name of a quantity, such as 'clearance'"),
)


def _mapping(values: object, keys: set[str], place: str) -> Mapping[str, Any]:
    if not isinstance(values, Mapping):
        raise _bad(place, values, "an object")
    mapping = cast("Mapping[str, Any]", values)
    if unknown := sorted(str(key) for key in mapping if key not in keys):
        raise _bad(place, unknown[0], f"the fields {', '.join(sorted(keys))}")
    return mapping


def _text(place: str, value: object, max_length: int) -> str:
    text = clean_name(value, max_length=max_length + 1) if isinstance(value, str) else ""
    if not 1 <= len(text) <= max_length or (isinstance(value, str) and len(value) > 2 * max_length):
        actual = f"{len(value)} characters" if isinstance(value, str) else value
        raise _bad(place, actual, f"text of 1 to {max_length} visible characters")
    return text


def _number(place: str, value: object, max_value: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= max_value:
        raise _bad(place, value, f"a whole number from 1 to {max_value}")
    return value


def _modules(place: str, values: object, max_value: int) -> tuple[int, ...]:
    several = cast("list[object]", values) if isinstance(values, list) else []
    if not 1 <= len(several) <= MAX_STOP_MODULES:
        raise _bad(place, values, f"a list of 1 to {MAX_STOP_MODULES} module numbers")
    return tuple(_number(place, value, max_value) for value in several)
