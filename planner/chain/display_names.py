"""Names: what strangers call shapes and folds, made fit to be shown on one line."""

from __future__ import annotations

import unicodedata
from typing import Final

MAX_NAME_LENGTH: Final = 80
"""Maximum length, in characters, of the displayed name of a shape or fold; the rest is cut off."""
_BLANKS: Final = frozenset("\u2800\u3164\uffa0\u115f\u1160\u17b4\u17b5\U0001d159\U00016fe4")
"""Characters without a visible form that are removed from names, although their Unicode categories
are those of letters, marks and symbols (Braille blank, fillers of Hangul, Khmer and Khitan, the
null notehead)."""
_IGNORABLE_MARKS: Final = (
    (0x034F, 0x034F),
    (0x180B, 0x180F),
    (0xFE00, 0xFE0F),
    (0xE0100, 0xE01EF),
)
"""Ranges of code points (first, last) of marks without a visible form that are removed from names:
joiners and variation selectors."""


def clean_name(name: str, *, max_length: int = MAX_NAME_LENGTH) -> str:
    """Return a name without characters that show nothing or reorder others; may be empty.

    Spaces of any kind become single plain ones. Control and format characters (zero width,
    direction, tags, soft hyphens), blank letters, variation selectors and unassigned code points
    are dropped, and combining marks that have nothing to stand on or are too many.

    Args:
        name: The name as somebody wrote it.
        max_length: Maximum number of characters; a longer name ends with ``…``.
    """
    letters: list[str] = []
    marks = 0
    for letter in name[: 20 * max_length]:
        kind = unicodedata.category(letter)
        if letter.isspace() or kind[0] == "Z":
            letter = " "
        elif kind[0] == "C" or letter in _BLANKS or _is_ignorable(letter):
            continue
        elif kind[0] == "M":
            marks += 1
            if not letters or letters[-1] == " " or marks > 4:  # scripts need three at most
                continue
            letters.append(letter)
            continue
        marks = 0
        letters.append(letter)
    words = " ".join("".join(letters).split())
    return words if len(words) <= max_length else words[: max_length - 1].rstrip() + "…"


def escaped(text: str) -> str:
    """Return a text for a terminal: characters that are not printable become escapes.

    Line breaks stay. Files may contain control sequences, which would change what a terminal shows.
    """
    return "".join(
        letter if letter.isprintable() or letter == "\n" else ascii(letter)[1:-1] for letter in text
    )


def _is_ignorable(letter: str) -> bool:
    return any(first <= ord(letter) <= last for first, last in _IGNORABLE_MARKS)
