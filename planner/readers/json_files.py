"""JSON: strict parsing, then the reader that the format asks for."""

from __future__ import annotations

import json
from typing import Any, Final, cast

from planner.chain import Chain
from planner.errors import InputError
from planner.paths import Path
from planner.readers.chain_json import read_chain
from planner.readers.limits import Source, quote, too_many
from planner.readers.path_json import path_from_rows, read_path

PATH_FORMAT: Final = "foldback-path/1"
CHAIN_FORMAT: Final = "foldback-chain/1"
DIGITS_OF_AN_INTEGER: Final = 18
HUGE: Final = 1e300
SPARE_VALUES: Final = 1000


def is_json(text: str) -> bool:
    """Whether the first character is that of a JSON object or list."""
    return text.lstrip()[:1] in ("{", "[")


def read_json(text: str, source: Source) -> Path | Chain:
    """A path or a chain from JSON.

    Raises:
        InputError: Naming the line, the key or the cell.
    """
    _check_amount(text, source)
    value = _parse(text)
    if isinstance(value, list):
        return path_from_rows(cast("list[Any]", value), source, name="", where="the list")
    document = cast("dict[str, Any]", value)
    found = document.get("format")
    if found == PATH_FORMAT:
        return read_path(document, source)
    if found == CHAIN_FORMAT:
        return read_chain(document, source)
    raise _wrong_format(document, found)


def _check_amount(text: str, source: Source) -> None:
    """Bounds what parsing can allocate, before it does."""
    lists = text.count("[") + text.count("{")
    if lists > source.most_cells + SPARE_VALUES:
        raise too_many(lists, source.most_cells, "lists")
    values = text.count(",")
    if values > 4 * source.most_cells + SPARE_VALUES:
        raise too_many(values, 4 * source.most_cells, "values")


def _parse(text: str) -> object:
    try:
        return json.loads(
            text,
            parse_int=_integer,
            object_pairs_hook=_no_duplicates,
        )
    except json.JSONDecodeError as error:
        where = f"line {error.lineno}, column {error.colno}"
        if error.pos >= len(text.rstrip()) or error.msg.startswith("Unterminated string"):
            raise InputError(
                "truncated",
                "the file ends in the middle of its JSON; save or send it again.",
                where=where,
            ) from error
        raise InputError(
            "bad-json", f"this is not JSON ({error.msg}); expected strict JSON.", where=where
        ) from error
    except RecursionError as error:
        raise InputError(
            "too-deep", "lists within lists too deep to follow; expected a list of cells."
        ) from error


def _integer(digits: str) -> int | float:
    """An integer; very long ones are cut to a float that every later check finds too large."""
    if len(digits) <= DIGITS_OF_AN_INTEGER:
        return int(digits)
    return max(-HUGE, min(HUGE, float(digits)))


def _no_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise InputError(
                "duplicate-key",
                f"the key {quote(key)!r} comes twice; keep one of them.",
                where=f"key {quote(key)!r}",
            )
        found[key] = value
    return found


def _wrong_format(document: dict[str, Any], found: object) -> InputError:
    expected = f'expected "{PATH_FORMAT}" or "{CHAIN_FORMAT}"'
    if found is None:
        if "asset" in document:
            return InputError("wrong-kind", f"this looks like a glTF mesh, {expected}.")
        keys = quote(", ".join(list(document)[:8])) or "none"
        return InputError(
            "no-format", f'got an object with the keys: {keys}; {expected} under "format".'
        )
    family, slash, version = found.partition("/") if isinstance(found, str) else ("", "", "")
    if slash and family in {f.partition("/")[0] for f in (PATH_FORMAT, CHAIN_FORMAT)}:
        return InputError(
            "wrong-version",
            f"got version {quote(version)!r} of {family}, {expected}.",
            where="format",
        )
    return InputError(
        "wrong-format", f"got the format {quote(found)!r}, {expected}.", where="format"
    )
