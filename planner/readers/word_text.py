"""Words: ``word:`` and some letters, to be folded as block letters."""

from __future__ import annotations

import re
from typing import Final

from foldback.planner.silhouettes.word import Word

PREFIX: Final = "word:"
"""Beginning of a text with a word."""
_BEGINNING: Final = re.compile(r"\s*word\s*:", re.IGNORECASE)


def is_word(text: str) -> bool:
    """Return True if a text begins with ``word:``."""
    return _BEGINNING.match(text) is not None


def read_word(text: str) -> Word:
    """Return the word in a text.

    Raises:
        InputError: It has no or too many letters, or one that cannot be drawn; names it.
    """
    return Word.of(_BEGINNING.sub("", text, count=1))
