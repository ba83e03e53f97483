"""Leash: the connection of a supervised process to the process that started it.

The supervised process ends when the other end closes, from its first moment on, and sends a pulse
in regular intervals, so that the supervisor notices if it hangs.
"""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Callable
from contextlib import suppress


class Leash:
    """Leash at standard input, a socket. A thread holds it.

    Args:
        pulse_s: Time between two pulses, s.

    Attributes:
        on_end: Called when the other end closes; by default, the process ends at once.
    """

    def __init__(self, pulse_s: float) -> None:
        self.on_end: Callable[[], None] = lambda: os._exit(0)
        self._socket = socket.socket(fileno=os.dup(0))
        self._socket.settimeout(pulse_s)
        threading.Thread(target=self._hold, name="leash", daemon=True).start()

    def _hold(self) -> None:
        with suppress(OSError):  # the other end closed before it had read all pulses
            while True:
                with suppress(BlockingIOError):  # the supervisor is stopped and reads no pulses
                    self._socket.send(b".", socket.MSG_DONTWAIT)
                with suppress(TimeoutError):
                    if not self._socket.recv(1):
                        break
        self.on_end()
