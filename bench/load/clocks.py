"""Clocks: the time of day as the processes of a service see it, which can jump."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import Final

JUMPING: Final = Path(__file__).parent / "jumping"


class Clock:
    """The time of day of all Python processes that are started with ``environment``.

    They are real processes with a clock that lies. Libraries that lie to the whole process
    (libfaketime) also stand between it and its locks, which makes it slower by a factor of ten.
    """

    def __init__(self, place: Path) -> None:
        self._file = place / "clock"
        self._file.write_bytes(bytes(8))
        inherited = filter(None, [os.environ.get("PYTHONPATH")])
        self.environment = {
            "FOLDBACK_LOAD_CLOCK": str(self._file),
            "PYTHONPATH": os.pathsep.join([str(JUMPING), *inherited]),
        }

    def set(self, ahead_s: int) -> None:
        """Lets the time of day be so many seconds ahead; behind if less than 0."""
        with open(self._file, "r+b") as file:  # the processes look at this very file
            file.write(struct.pack("<q", ahead_s * 1_000_000_000))
