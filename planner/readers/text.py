"""Text: decoding, and the numbers that CSV and XYZ files hold."""

from __future__ import annotations

import codecs
import re
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.path import LARGEST_COORDINATE
from planner.errors import InputError
from planner.readers.kinds import wrong_kind
from planner.readers.limits import quote

NUMBER: Final = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,4})?\Z")
NOT_FINITE: Final = re.compile(r"[+-]?(?:nan|inf|infinity)\Z", re.IGNORECASE)
SEPARATOR: Final = re.compile(r'[\s,;"]+')
COMMENT: Final = "#"
LOOKED_AT: Final = 20_000


def decode(data: bytes, expected: str) -> str:
    """Text of a file in UTF-8, or in UTF-16 where its first bytes say so.

    Raises:
        InputError: ``wrong-kind`` when it is not text.
    """
    marked = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        text = data.decode("utf-16" if marked else "utf-8-sig")
    except UnicodeDecodeError as error:
        raise wrong_kind(f"byte {error.start} is not text: a binary file", expected) from error
    if "\0" in text:
        place = text.index("\0")
        raise wrong_kind(f"character {place} is a zero byte: a binary file", expected)
    return text


def refuse_binary(data: bytes, expected: str) -> None:
    """Refuses what is not text by its first bytes, whatever its size; see ``decode``.

    Raises:
        InputError: ``wrong-kind``.
    """
    start = data[:LOOKED_AT]
    if start.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return
    try:
        text = codecs.getincrementaldecoder("utf-8-sig")().decode(start)
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        decode(start, expected)


def refuse_prose(text: str, expected: str) -> None:
    """Refuses text without a single number near its beginning.

    Raises:
        InputError: ``wrong-kind``, quoting its first line.
    """
    words = SEPARATOR.split(text.strip()[:LOOKED_AT])
    if not any(is_number(word) for word in words):
        raise wrong_kind(f"this is text that begins with {quote(text.strip())!r}", expected)


def coordinate(field: str, axis: str, line: int) -> float:
    """One coordinate of a cell.

    Raises:
        InputError: When it is not a whole number of sensible size; ``where`` names the line.
    """
    where = f"line {line}"
    word = field.strip()
    if NOT_FINITE.match(word):
        raise InputError(
            "not-finite", f"got {quote(word)} for {axis}, expected a whole number.", where=where
        )
    if not NUMBER.match(word):
        found = f"got {quote(word)!r}" if word else "got nothing"
        raise InputError(
            "not-a-number", f"{found} for {axis}, expected a whole number.", where=where
        )
    value = float(word)
    if abs(value) > LARGEST_COORDINATE:
        raise InputError(
            "too-far",
            f"got {quote(word)} for {axis}, expected at most {LARGEST_COORDINATE} in size; move "
            "the shape to the origin.",
            where=where,
        )
    if value != round(value):
        raise InputError(
            "not-whole",
            f"got {quote(word)} for {axis}, expected a whole number: cells lie on an integer "
            "lattice; scale and shift the shape.",
            where=where,
        )
    return value


def is_number(field: str) -> bool:
    """Whether a field is written as a number, finite or not."""
    word = field.strip()
    return bool(NUMBER.match(word) or NOT_FINITE.match(word))


def cells_array(rows: Sequence[Sequence[float]]) -> NDArray[np.int64]:
    """(n, 3) cells from checked rows."""
    return np.array(rows, dtype=np.int64).reshape(-1, 3)
