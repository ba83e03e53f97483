"""Faults: small realistic mistakes, each a replacement of one piece of text by another.

They stand in ``planner.toml``, ``server.toml`` and ``web.toml``. Who moves the code moves ``file``
along, who changes it changes ``old``; ``test_faults.py`` says which.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

HERE: Final = Path(__file__).parent


class StaleFaultError(Exception):
    """The code is not there any more in which a fault is made."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One mistake.

    Attributes:
        name: Its name.
        breaks: What is wrong with it, in one line.
        file: Where it is made, from the root of the checkout on.
        old: What stands there, exactly once.
        new: What stands there instead.
        likely: Arguments for pytest: the tests that should find it.
    """

    name: str
    breaks: str
    file: str
    old: str
    new: str
    likely: tuple[str, ...]

    def applied(self, text: str) -> str:
        """The text of its file with the mistake in it.

        Raises:
            StaleFaultError: When the old text is not there exactly once.
        """
        found = text.count(self.old)
        if found != 1:
            raise StaleFaultError(
                f"{self.name}: got its old text {found} times in {self.file}, expected it once; "
                "adapt the fault to the code."
            )
        return text.replace(self.old, self.new)


def all_faults() -> tuple[Fault, ...]:
    """The faults of all rooms."""
    return tuple(
        Fault(name=name, **{**told, "likely": tuple(told["likely"])})
        for path in sorted(HERE.glob("*.toml"))
        for name, told in tomllib.loads(path.read_text(encoding="utf-8")).items()
    )
