"""Strict JSON: parsing that refuses duplicate and unread keys, bounded before it begins."""

from __future__ import annotations

import json
import re
from collections.abc import Collection
from typing import Any, Final

from foldback.planner.chain.display_names import clean_name
from foldback.planner.chain.path import DEFAULT_PITCH_M
from foldback.planner.errors import InputError
from foldback.planner.readers.limits import MAX_CELLS, described, quote, too_many

HUGE_NUMBER: Final = 1e300
"""Magnitude to which JSON integers that are too long for exact parsing are clipped, so that they
stay finite; every later check of a range refuses it."""
SPARE_VALUES: Final = 1000
"""Number of lists, and of values, that a JSON file may have beyond those of its cells; a file with
more is refused before it is parsed."""
KEYS_OF_FORM: Final = re.compile(
    r"(?:unit|pitch|scale|ax[ei]s|order|origin|offset|rotat|transform|mirror|joint|angle|cell|closed|module\b)"
)
"""Matches the beginnings of JSON keys that probably change a shape's form, size or place; an
unknown key that matches is refused rather than ignored."""


def _check_amount(text: str, max_cells: int) -> None:
    """Refuse text whose parsing would take too much memory."""
    lists = text.count("[") + text.count("{")
    if lists > max_cells + SPARE_VALUES:
        raise too_many(lists, max_cells, "lists")
    values = text.count(",")
    if values > 4 * max_cells + SPARE_VALUES:
        raise too_many(values, 4 * max_cells, "values")


def parse(text: str, max_cells: int = MAX_CELLS) -> object:
    """Parse strict JSON.

    Raises:
        InputError: The text is no JSON (names line and column), or has too many values.
    """
    _check_amount(text, max_cells)
    try:
        return json.loads(
            text,
            parse_int=_integer,
            object_pairs_hook=_no_duplicates,
        )
    except json.JSONDecodeError as error:
        position = f"line {error.lineno}, column {error.colno}"
        if error.pos >= len(text.rstrip()) or error.msg.startswith("Unterminated string"):
            raise InputError(
                "truncated",
                "the file ends in the middle of its JSON; save or send it again.",
                where=position,
            ) from error
        raise InputError(
            "bad-json",
            f"this is not valid JSON ({error.msg}); correct the file, or save it again.",
            where=position,
        ) from error
    except RecursionError as error:
        raise InputError(
            "too-deep", "got lists nested too deeply, expected a list of cells."
        ) from error


def _integer(digits: str) -> int | float:
    """Parse an integer; clip very long ones to a float that later checks refuse."""
    if len(digits) <= 18:  # fits into 64 bits
        return int(digits)
    return max(-HUGE_NUMBER, min(HUGE_NUMBER, float(digits)))


def _no_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for key, value in pairs:
        if key in result:
            raise InputError(
                "duplicate-key",
                f"the key {quote(key)!r} occurs more than once; keep only one.",
                where=f"key {quote(key)!r}",
            )
        result[key] = value
    return result


def refuse_unread_keys(document: dict[str, Any], known_keys: Collection[str]) -> None:
    """Refuse keys that would change the form, place or size of a shape; others say nothing of it.

    Args:
        document: An object of one of foldback's formats.
        known_keys: Keys of the format.

    Raises:
        InputError: ``unknown-key``.
    """
    for key in document:
        if key not in known_keys and KEYS_OF_FORM.match(key.casefold()):
            raise InputError(
                "unknown-key",
                f"got the unknown key {quote(key)!r}, expected one of: {', '.join(known_keys)}; "
                "use one of these keys, or remove the unknown key.",
                where=quote(key),
            )


def name_field(document: dict[str, Any]) -> str:
    """Return the ``name``, cleaned for display; empty if it is missing.

    Raises:
        InputError: ``wrong-type`` when it is no text.
    """
    value = document.get("name", "")
    if not isinstance(value, str):
        raise InputError("wrong-type", f"got {described(value)}, expected text.", where="name")
    return clean_name(value)


def pitch_field(document: dict[str, Any]) -> float:
    """Return the ``pitch_m``, or the usual pitch if it is missing.

    Raises:
        InputError: ``wrong-type`` when it is no number.
    """
    value = document.get("pitch_m", DEFAULT_PITCH_M)
    if type(value) is not int and type(value) is not float:
        raise InputError(
            "wrong-type", f"got {described(value)}, expected a number.", where="pitch_m"
        )
    return float(value)
