"""Stop signals: SIGTERM and SIGINT of the service's processes, which have one owner at any time."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Final

STOP_SIGNALS: Final = (signal.SIGTERM, signal.SIGINT)


def on_stop_signals(handle: Callable[[int, FrameType | None], object]) -> None:
    """Handle stop signals from now on; other threads than the main one cannot, and do nothing."""
    if threading.current_thread() is threading.main_thread():
        for number in STOP_SIGNALS:
            signal.signal(number, handle)


def end_at_stop_signals() -> None:
    """Let a stop signal end this process at once, as long as it has started nothing to be ended.

    Python would raise KeyboardInterrupt for SIGINT, which gets lost if it interrupts a callback of
    an import. Processes that this one starts end with it.
    """
    on_stop_signals(_end)


def _end(number: int, _frame: FrameType | None) -> None:
    signal.signal(number, signal.SIG_DFL)
    signal.raise_signal(number)
    os._exit(128 + number)  # the kernel spares the first process of a container
