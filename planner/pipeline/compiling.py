"""Compiling: when kernels are compiled, by whom, and that somebody is told."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from numba.core.event import Event, Listener, install_listener

from planner.progress import COMPILING, Progress, Report, silent

if sys.platform != "win32":
    from fcntl import LOCK_EX, flock


class Compiling(Listener):
    """Tells, once, that something is compiled while its context lasts.

    Args:
        progress: Told ``COMPILING`` when it begins.
    """

    def __init__(self, progress: Report = silent) -> None:
        self._progress = progress
        self._listening = install_listener("numba:compile", self)
        self.told = False

    def __enter__(self) -> Compiling:
        self._listening.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._listening.__exit__(None, None, None)

    def on_start(self, event: Event) -> None:
        """The compiler begins with a kernel."""
        if not self.told:
            self.told = True
            self._progress(Progress(stage="read", fraction=0.0, message=COMPILING))

    def on_end(self, event: Event) -> None:
        """It has ended."""


def beside(part: str) -> subprocess.Popen[bytes]:
    """Warms up in another process: ``motions``, or ``all``, for which it steps back.

    It runs on by itself; who waits for it uses it as a context.
    """
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "planner.pipeline.warm_up", part],
        stdin=subprocess.DEVNULL,  # ours is for requests
    )


@contextmanager
def alone() -> Generator[None]:
    """Holds back others on this machine that warm up; on Windows they compile the same twice."""
    if sys.platform == "win32":
        yield
        return
    kernels = os.open(Path(__file__).parents[1] / "kernels", os.O_RDONLY)
    try:
        flock(kernels, LOCK_EX)
        yield
    finally:
        os.close(kernels)
