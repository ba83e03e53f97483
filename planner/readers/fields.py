"""Fields that JSON documents share: names and lengths."""

from __future__ import annotations

from typing import Any

from planner.errors import InputError
from planner.readers.limits import clean_name, quote


def text_field(document: dict[str, Any], key: str) -> str:
    """A text, cleaned for showing; empty when it is missing.

    Raises:
        InputError: ``wrong-type`` when it is something else.
    """
    value = document.get(key, "")
    if not isinstance(value, str):
        raise InputError("wrong-type", f"got {quote(value)}, expected a text.", where=key)
    return clean_name(value)


def number_field(document: dict[str, Any], key: str, default: float) -> float:
    """A number, ``default`` when it is missing.

    Raises:
        InputError: ``wrong-type`` when it is something else.
    """
    value = document.get(key, default)
    if type(value) is not int and type(value) is not float:
        raise InputError("wrong-type", f"got {quote(value)}, expected a number.", where=key)
    return float(value)
