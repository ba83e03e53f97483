"""Values that the owner of a fold stores with it, one for each module: docs/links.md."""

from __future__ import annotations

import base64
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final, cast

from foldback.planner.chain.display_names import clean_name
from foldback.planner.errors import InputError, unexpected
from foldback.planner.storage.file_names import OWN_VALUES
from foldback.planner.storage.files import json_of

_bad: Final = partial(unexpected, "bad-values")
VALUES_FORMAT: Final = "foldback-values/1"
MAX_VALUES_NAME_CHARACTERS: Final = 80
"""Maximum number of characters of the name that the owner of a fold gives to the values by which
its modules are coloured, and which a menu shows; a longer one is refused."""
MAX_UNIT_CHARACTERS: Final = 20
"""Maximum number of characters of the unit of the values by which an owner colours a fold's
modules, which stands beside the colour scale; a longer one is refused."""
FIELDS: Final = frozenset({"format", "name", "unit", "low", "high", "rows", "data"})


def checked_values(values: object, modules: int) -> dict[str, Any]:
    """Return numbers for modules as plain JSON values, with cleaned texts.

    Args:
        values: ``name`` and ``unit``; the scale from ``low`` to ``high``; ``rows``, and their bytes
            in base64 as ``data``: for each module of each row a level of the scale from 0 to 254,
            or 255 where there is no number. Several rows are spread evenly over the frames.
        modules: Number of modules of the fold.

    Raises:
        InputError: ``bad-values``: saying what was found, what is expected, and where.
    """
    metadata = cast("Mapping[str, Any]", values) if isinstance(values, Mapping) else {}
    if metadata.get("format") != VALUES_FORMAT:
        raise _bad("format", metadata.get("format"), VALUES_FORMAT)
    odd = [
        *sorted(metadata.keys() - FIELDS),
        *(f"no {name}" for name in sorted(FIELDS - metadata.keys())),
    ]
    if odd:
        raise _bad("fields", odd[0], ", ".join(sorted(FIELDS)))
    for name, max_characters in (
        ("name", MAX_VALUES_NAME_CHARACTERS),
        ("unit", MAX_UNIT_CHARACTERS),
    ):
        if not isinstance(metadata[name], str) or len(metadata[name]) > max_characters:
            raise _bad(name, metadata[name], f"text of at most {max_characters} characters")
    low, high, rows, data = (metadata[key] for key in ("low", "high", "rows", "data"))
    numbers = all(type(x) in (int, float) and abs(x) <= sys.float_info.max for x in (low, high))
    if not numbers or low > high:
        raise _bad("low", f"{low} to {high}", "two finite numbers, where 'low' is at most 'high'")
    max_rows = max(1, 45_000 // modules)  # more do not fit into the body of a request
    if type(rows) is not int or not 1 <= rows <= max_rows:
        raise _bad("rows", rows, f"1 to {max_rows}")
    try:
        levels = base64.b64decode(data, validate=True)
    except (TypeError, ValueError):
        raise _bad("data", data, "bytes in base64") from None
    if len(levels) != rows * modules:
        expectation = "bytes, one for each module in each row"
        raise _bad("data", f"{len(levels)} bytes", f"{rows * modules} {expectation}")
    return {
        **metadata,
        "name": clean_name(metadata["name"], max_length=MAX_VALUES_NAME_CHARACTERS)
        or "Numbers from a file",
        "unit": clean_name(metadata["unit"], max_length=MAX_UNIT_CHARACTERS),
    }


def values_in(directory: Path, modules: int) -> dict[str, Any] | None:
    """Return the numbers in a fold's directory; None without any, or any that are right."""
    try:
        return checked_values(json_of(directory / OWN_VALUES), modules)
    except InputError:
        return None
