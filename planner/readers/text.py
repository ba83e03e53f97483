"""Text: decoding, the numbers that CSV and XYZ files hold, and what lists of cells become."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from foldback.planner.arrays import Ints
from foldback.planner.chain.path import DEFAULT_PITCH_M, MAX_COORDINATE, Path
from foldback.planner.errors import InputError
from foldback.planner.readers.limits import Source, quote
from foldback.planner.readers.refused_formats import wrong_kind
from foldback.planner.shapes.shape import Shape

NUMBER_PATTERN: Final = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,4})?\Z")
NOT_FINITE: Final = re.compile(r"[+-]?(?:nan|inf|infinity)\Z", re.IGNORECASE)
WORD_SEPARATOR: Final = re.compile(r'[\s,;"]+')
COMMENT_MARK: Final = "#"
HASH_COMMENT: Final = re.compile("#[^\n]*")
"""Matches a comment of a text file: from a number sign to the end of the line."""
TEXT_LINE: Final = re.compile(r"[^ \t\r\n\f\v][^\r\n]*")
"""Matches the text of a line from its first character that is no blank. Lines end at CR and LF
alone: other characters that Unicode counts as line ends occur in comments and names."""
BYTE_LINE: Final = re.compile(rb"[^ \t\r\n\f\v][^\r\n]*")
"""As ``TEXT_LINE``, in bytes."""
DATA_LINE: Final = re.compile(rb"(?:\A|(?<=[\r\n]))[ \t]*+[^# \t\r\n]")
"""Matches the beginning of a line that is neither blank nor a comment."""
CONTROL: Final = re.compile(rb"[\x00-\x08\x0e-\x19\x1b-\x1f]")
"""Matches control characters that text files do not contain. White space is allowed, and so is the
end mark of old systems (0x1A)."""
PADDING: Final = b"\0\x1a \t\r\n"
"""Bytes that may follow the data of a file without a meaning: line ends, blanks, and what old
systems and tapes filled files up with."""
TEXT_PROBE_SIZE: Final = 20_000
"""Number of bytes, or characters, at the beginning of a file that are checked to be text, and to
contain a number."""
BYTE_ORDER_MARKS: Final = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
"""Byte order marks with their encodings, tried in this order: the marks of UTF-32 come first, as
that of little-endian UTF-32 begins like that of UTF-16."""
READ_AS_VOXELS: Final = (
    "if the order of the cells has no meaning, read the cells as a shape (option as_voxels)"
)


def data_start(data: bytes) -> int:
    """Return where the first line begins that is neither blank nor a comment."""
    line = DATA_LINE.search(data)
    return len(data) if line is None else line.start()


def without_comments(data: bytes) -> bytes:
    """Return a text file whose lines end with LF without its comments."""
    if b"#" not in data:
        return data
    # The same of bytes takes ten times the memory, because joining bytes takes a buffer for each.
    return HASH_COMMENT.sub("", data.decode("latin-1")).encode("latin-1")


def numbered_lines(text: str) -> Iterator[tuple[int, str]]:
    """Yield the lines of a text that are not blank, each with its number, without leading blanks.

    Nothing is stored for blank lines, so that a file of line ends takes no memory.

    Args:
        text: Text whose lines end with LF.
    """
    number, at = 1, 0
    for match in TEXT_LINE.finditer(text):
        number += text.count("\n", at, match.start())
        at = match.start()
        yield number, match[0]


def to_utf8(data: bytes) -> bytes:
    """Return the same file without a byte order mark, and text in UTF-16 or UTF-32 as UTF-8."""
    for mark, encoding in BYTE_ORDER_MARKS:
        if data.startswith(mark):
            try:
                return data[len(mark) :].decode(encoding).encode()
            except UnicodeError:
                return data
    pairs = data[: 2 * 64]  # 64 characters
    for encoding, first in (("utf-16-le", 0), ("utf-16-be", 1)):
        # Without a mark, every other byte of plain text is zero.
        if len(pairs) >= 8 and not any(pairs[1 - first :: 2]) and all(pairs[first::2]):
            try:
                text = data.decode(encoding)
            except UnicodeError:
                return data
            return data if "\0" in text else text.encode()
    return data


def decode(data: bytes, expected: str) -> str:
    """Return the text of a file in UTF-8, or in Windows' Western encoding; its lines end with LF.

    Raises:
        InputError: ``wrong-kind`` when it is not text.
    """
    data = data.rstrip(PADDING)
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        if CONTROL.search(data):
            raise wrong_kind(
                f"this looks like a binary file (byte {error.start} is not text)", expected
            ) from error
        text = data.decode("cp1252", "replace")
    if "\0" in text:
        place = text.index("\0")
        raise wrong_kind(
            f"this looks like a binary file (character {place} is a zero byte)", expected
        )
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def refuse_binary(data: bytes, expected: str) -> None:
    """Refuse files whose first bytes are not text; see ``decode``.

    Raises:
        InputError: ``wrong-kind``.
    """
    start = data[:TEXT_PROBE_SIZE]
    try:
        text = codecs.getincrementaldecoder("utf-8")().decode(start)
    except UnicodeDecodeError:
        text = "\0" if CONTROL.search(start) else ""
    if "\0" in text:
        decode(start, expected)


def refuse_prose(text: str, expected: str) -> None:
    """Refuse text without a single number near its beginning.

    Raises:
        InputError: ``wrong-kind``; quotes its first line.
    """
    words = WORD_SEPARATOR.split(text.strip()[:TEXT_PROBE_SIZE])
    if not any(is_number(word) for word in words):
        raise wrong_kind(
            f"this looks like plain text (it begins with {quote(text.strip())!r})", expected
        )


def coordinate(field: str, axis: str, line: int) -> float:
    """Parse one coordinate of a cell.

    Raises:
        InputError: The field is no whole number up to ``MAX_COORDINATE``; names the line.
    """
    place = f"line {line}"
    word = field.strip()
    if NOT_FINITE.match(word):
        raise InputError(
            "not-finite", f"got {quote(word)} for {axis}, expected a whole number.", where=place
        )
    if not NUMBER_PATTERN.match(word):
        problem = f"got {quote(word)!r}" if word else "got nothing"
        raise InputError(
            "not-a-number", f"{problem} for {axis}, expected a whole number.", where=place
        )
    value = float(word)
    if abs(value) > MAX_COORDINATE:
        raise InputError(
            "too-far",
            f"got {quote(word)} for {axis}, expected −{MAX_COORDINATE} to {MAX_COORDINATE}; "
            "move the shape to the origin.",
            where=place,
        )
    if value != round(value):
        raise InputError(
            "not-whole",
            f"got {quote(word)} for {axis}, expected a whole number; scale and shift the shape, "
            "because cells lie on a grid of whole numbers.",
            where=place,
        )
    return value


def is_number(field: str) -> bool:
    """Return True if a field is a number, finite or not."""
    word = field.strip()
    return bool(NUMBER_PATTERN.match(word) or NOT_FINITE.match(word))


def cells_array(rows: Sequence[Sequence[float]]) -> Ints:
    """Return the (n, 3) cells of checked rows."""
    return np.array(rows, dtype=np.int64).reshape(-1, 3)


def path_or_shape(
    cells: ArrayLike, source: Source, *, name: str = "", pitch_m: float = DEFAULT_PITCH_M
) -> Path | Shape:
    """Return a path of cells in their order, or a shape if ``source.as_voxels`` is set.

    Raises:
        InputError: The cells are no path; if only their order is wrong, names the alternative.
    """
    if source.as_voxels:
        return Shape.from_cells(cells, name=name or source.name or "shape", pitch_m=pitch_m)
    try:
        return Path.from_cells(cells, name=name or source.name or "path", pitch_m=pitch_m)
    except InputError as refusal:
        if refusal.code != "not-adjacent":
            raise
        template = f"{refusal.template.removesuffix('.')}; {READ_AS_VOXELS}."
        raise refusal.changed(template) from refusal
