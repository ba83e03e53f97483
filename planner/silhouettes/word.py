"""Word: text in block letters that stand on a bar, as one drawing in cells."""

from __future__ import annotations

import unicodedata
from dataclasses import dataclass
from typing import Final

import numpy as np

from foldback.planner.arrays import Flags
from foldback.planner.errors import InputError
from foldback.planner.shapes.bridges import parts_of
from foldback.planner.silhouettes.block_letters import drawing_of

MAX_LETTERS: Final = 12
"""Maximum number of letters of a word, blanks not counted."""
MAX_TYPED_CHARACTERS: Final = 200
"""Maximum number of characters of a word as it was typed; more are not even looked at."""
BLANK_WIDTH: Final = 2
"""Width of a blank between words, in cells, in addition to the gaps beside it."""
BAR_DISTANCE: Final = 1
"""Number of empty rows between letters and the bar below them; a foot of each letter crosses them.
Without such a row, an F on the bar would look like an E."""
SCRIPTS: Final = "Latin, Greek, Cyrillic and Hebrew"


@dataclass(frozen=True, slots=True, kw_only=True)
class Word:
    """A word in block letters.

    Attributes:
        text: Its capitals and blanks in the order of reading.
    """

    text: str

    @classmethod
    def of(cls, typed: str) -> Word:
        """Return the word for a text as it was typed.

        Raises:
            InputError: It has no or too many letters, or one that cannot be drawn; names it.
        """
        if len(typed) > MAX_TYPED_CHARACTERS:
            raise _too_long(len(typed))
        text = " ".join(unicodedata.normalize("NFC", typed).upper().split())
        text = unicodedata.normalize("NFC", text)
        letters = text.replace(" ", "")
        if not letters:
            raise InputError("empty", f"got no letter, expected 1 to {MAX_LETTERS} letters.")
        if len(letters) > MAX_LETTERS:
            raise _too_long(len(letters))
        for letter in letters:
            if drawing_of(letter) is None:
                raise InputError(
                    "unknown-letter",
                    f"there is no block letter for {_described(letter)}, expected letters of "
                    f"{SCRIPTS}, digits, or one of & + - ? . ' ♥. Use another letter, or make a "
                    "picture of the word and fold that.",
                )
        directions = {unicodedata.bidirectional(letter) == "R" for letter in letters}
        if len(directions) > 1 and True in directions:
            raise InputError(
                "mixed-directions",
                "got letters that are written from right to left together with others, expected "
                "one direction; fold them as two words.",
            )
        return cls(text=text)

    @property
    def drawing(self) -> Flags:
        """(rows, columns) cells of the letters and the bar below them, the top row first."""
        is_rightwards = unicodedata.bidirectional(self.text[0]) != "R"
        columns: list[Flags] = []
        letters = [drawing_of(letter) for letter in self.text if letter != " "]
        drawings = iter(letter for letter in letters if letter is not None)
        height = max(len(letter) for letter in letters if letter is not None)
        for letter in self.text:
            if letter == " ":
                columns.append(np.zeros((height, BLANK_WIDTH), dtype=np.bool_))
                continue
            drawing = next(drawings)
            columns.append(np.pad(drawing, ((height - len(drawing), 0), (0, 1))))
        if not is_rightwards:
            columns.reverse()
        return _on_a_bar(np.hstack(columns)[:, :-1])


def _on_a_bar(letters: Flags) -> Flags:
    """Return drawings with a bar below them, and a foot of each part that reaches the last row."""
    numbers, _ = parts_of(letters)
    feet = np.zeros((BAR_DISTANCE, letters.shape[1]), dtype=np.bool_)
    for part in np.unique(numbers[-1][letters[-1]]):
        columns = np.flatnonzero(np.any(numbers == part, axis=0))
        middle = (columns[0] + columns[-1]) // 2
        standing = np.flatnonzero(numbers[-1] == part)
        feet[:, middle if middle in standing else standing[0]] = True
    return np.vstack([letters, feet, np.ones((1, letters.shape[1]), dtype=np.bool_)])


def _described(letter: str) -> str:
    if not letter.isprintable():
        return f"the character U+{ord(letter):04X}"
    name = unicodedata.name(letter, "")
    return f"“{letter}”" + (f" ({name.lower()})" if name and not letter.isascii() else "")


def _too_long(count: int) -> InputError:
    return InputError(
        "too-long",
        f"got {count} letters, expected 1 to {MAX_LETTERS}; shorten the word, or fold it in parts.",
    )
