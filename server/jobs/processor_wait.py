"""Processor wait: whether a computing process waits for a processor, which other work occupies."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path


class ProcessorWait:
    """Measurement of a process's wait for a processor, from its scheduler statistics (Linux).

    Args:
        read_s: Returns the seconds for which a process has waited; None if it is not known.
        clock: Monotonic clock in seconds.
    """

    def __init__(
        self,
        read_s: Callable[[int], float | None] | None = None,
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._read_s = read_s or waited_s
        self._clock = clock
        self._pid = 0
        self._since = self._waited_s = 0.0
        self._busy = False

    def busy(self, pid: int) -> bool:
        """Return True if the process has waited for a processor for much of the last seconds."""
        now, waited = self._clock(), self._read_s(pid)
        if waited is None:
            return False
        passed_s = now - self._since
        if pid == self._pid and passed_s < 2.0:
            return self._busy
        # its folds take 1.7 times as long as alone
        self._busy = pid == self._pid and waited - self._waited_s > 0.4 * passed_s
        self._pid, self._since, self._waited_s = pid, now, waited
        return self._busy


def waited_s(pid: int) -> float | None:
    """Return the time for which a process has waited for a processor, in s; None if unknown."""
    try:
        return int(Path(f"/proc/{pid}/schedstat").read_text().split()[1]) / 1e9
    except (OSError, ValueError, IndexError):
        return None
