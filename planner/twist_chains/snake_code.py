"""Codes of figures of a Rubik's snake: one digit for each joint between two prisms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from foldback.planner.errors import InputError

LETTERS: Final = {"fiore": "DLUR", "glsnake": "ZRPL"}
"""Letters of the digits 0, 1, 2 and 3 in two notations: that of A. Fiore (down, left, up, right),
and that of the program glsnake (zero, right, pin, left)."""
NOTATIONS: Final = ("digits", *LETTERS, "wolter")
"""Names of the notations in which a code can be read and written."""
MIN_DIGITS: Final = 1
"""Minimum number of joints of a snake."""


@dataclass(frozen=True, slots=True)
class SnakeCode:
    """A figure of a Rubik's snake.

    Attributes:
        digits: Turn of each joint from the first prism on, in quarter turns about the direction of
            the chain, counterclockwise seen from the end: 0 is straight, as in the rod.
    """

    digits: tuple[int, ...]

    def __post_init__(self) -> None:
        """Raise InputError if there is no digit, or one that is not 0 to 3."""
        if len(self.digits) < MIN_DIGITS:
            raise InputError("wrong-count", "got no digit, expected one for each joint.")
        for joint, digit in enumerate(self.digits):
            if digit not in range(4):
                raise InputError(
                    "bad-digit",
                    f"got {digit} at joint {joint + 1}, expected 0, 1, 2 or 3 quarter turns.",
                )

    @property
    def prisms(self) -> int:
        """Number of prisms."""
        return len(self.digits) + 1

    def mirrored(self) -> SnakeCode:
        """Return the code of the mirror image: 1 and 3 change places."""
        return SnakeCode(tuple(-digit % 4 for digit in self.digits))

    def from_other_end(self) -> SnakeCode:
        """Return the code of the same figure read from the last prism to the first."""
        return SnakeCode(self.digits[::-1])

    def text(self, notation: str = "digits") -> str:
        """Return the code in one of the ``NOTATIONS``."""
        if notation == "wolter":
            return self._wolter_text()
        letters = LETTERS.get(notation, "0123")
        return "".join(letters[digit] for digit in self.digits)

    def _wolter_text(self) -> str:
        """Return the joints that are turned as Wolter writes them; all straight ones are left out.

        His lists number every second prism. Joint 2k lies on the right side of prism k + 1, joint
        2k − 1 on its left side, where quarter turns count the other way.
        """
        steps: list[str] = []
        for joint, digit in enumerate(self.digits):
            if digit:
                prism, side = (joint + 1) // 2 + 1, "LR"[joint % 2 == 0]
                steps.append(f"{prism}{side}{digit if side == 'R' else -digit % 4}")
        return "-".join(steps) or "1R0"
