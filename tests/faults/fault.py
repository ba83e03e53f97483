"""Faults: small realistic mistakes, each a replacement of one piece of text by another.

They are listed in ``planner.toml``, ``server.toml`` and ``web.toml``. A change that moves the code
also updates ``file``, one that edits it ``old``; ``test_faults.py`` reports the outdated ones.
"""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

HERE: Final = Path(__file__).parent


class StaleFaultError(Exception):
    """Error of a fault whose original code is no longer in the file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One mistake.

    Attributes:
        name: Name of the fault.
        breaks: Behaviour that is wrong with it, in one line.
        file: Path of the changed file, relative to the root of the checkout.
        old: Original text, which the file holds exactly once.
        new: Text that replaces it.
        likely: Arguments for pytest: the tests that should find it.
    """

    name: str
    breaks: str
    file: str
    old: str
    new: str
    likely: tuple[str, ...]

    def apply(self, text: str) -> str:
        """Return the text of its file with the mistake in it.

        Raises:
            StaleFaultError: If the file does not hold the old text exactly once.
        """
        times = text.count(self.old)
        if times != 1:
            raise StaleFaultError(
                f"{self.name}: got its old text {times} times in {self.file}, expected it once; "
                "adapt the fault to the code."
            )
        return text.replace(self.old, self.new)


def all_faults() -> tuple[Fault, ...]:
    """Return the faults of all files."""
    return tuple(
        Fault(name=name, **{**values, "likely": tuple(values["likely"])})
        for path in sorted(HERE.glob("*.toml"))
        for name, values in tomllib.loads(path.read_text(encoding="utf-8")).items()
    )
