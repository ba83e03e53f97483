"""Interrupts (SIGINT, Ctrl+C) of commands that compute."""

from __future__ import annotations

import signal
import sys
from types import FrameType
from typing import Final

INTERRUPTED: Final = 130
"""Exit status of a command that Ctrl-C has ended, as of shells."""
IMPORTING: Final = "importlib._bootstrap"
"""Module of the functions that are running while Python imports something."""
RETRY_S: Final = 0.05
"""Time after which an interrupt is tried again, in seconds."""


class Interrupts:
    """Interrupts that reach the command wherever they come.

    An extension module may lose a KeyboardInterrupt that is raised while it calls Python, or may
    raise another exception instead, as MuJoCo does: in its import, and for an argument that it
    converts. So an interrupt waits for the end of an import, and is repeated until it unwinds the
    stack. A second interrupt ends what the first one is unwinding, too.

    Attributes:
        came: True once there was an interrupt.
    """

    def __init__(self) -> None:
        self.came = False

    def handle(self) -> None:
        """Handle interrupts from now on; where they are ignored, they stay so."""
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            for number in (signal.SIGINT, signal.SIGALRM):
                signal.signal(number, self._interrupt)

    def end(self) -> None:
        """Repeat the interrupt no longer."""
        signal.setitimer(signal.ITIMER_REAL, 0)

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        is_second = self.came and number == signal.SIGINT
        self.came = True
        signal.setitimer(signal.ITIMER_REAL, RETRY_S)
        is_unwinding = sys.exc_info()[1] is not None
        if is_second or not (is_unwinding or _is_importing(frame)):
            raise KeyboardInterrupt


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_globals.get("__name__") == IMPORTING:
            return True
        frame = frame.f_back
    return False
