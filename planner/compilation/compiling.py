"""Compiling: when kernels are compiled, in which processes, and how far that is."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from numba.core.event import Event, Listener, install_listener

from foldback.planner.compilation.compiling_lock import LOCK_POLL_S, CompilingLock, fraction_of
from foldback.planner.progress import COMPILING, Progress, Report, silent

KERNEL_PACKAGE_PREFIX: Final = "foldback.planner.kernels."
GC_THRESHOLD_OBJECTS: Final = 100_000
"""Newly allocated objects after which Python's garbage collector runs while numba compiles kernels
(threshold 0 of ``gc.set_threshold``). Python's default of 700 spends an eighth of the compilation
on it; a larger value compiles faster and takes more memory. Measured."""


class Compiling(Listener):
    """Report how far the compilation is while its context lasts.

    Args:
        progress: Called with ``COMPILING`` and a fraction when it begins and after each kernel.
        lock: Taken when the first kernel is compiled, so that nothing waits where all are.
        joined: The lock belongs to another process, which this one compiles for.
    """

    def __init__(
        self, progress: Report = silent, *, lock: CompilingLock | None = None, joined: bool = False
    ) -> None:
        self._progress = progress
        self._lock = lock
        self._joined = joined
        self._listening = install_listener("numba:compile", self)
        self._compiled_bytes = 0
        self._collected_after = gc.get_threshold()
        self.has_reported = False

    def __enter__(self) -> Compiling:
        self._listening.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._listening.__exit__(None, None, None)
        gc.set_threshold(*self._collected_after)
        if self._lock is not None:
            self._lock.release()

    def on_start(self, event: Event) -> None:
        """The compiler begins with a kernel."""
        if self.has_reported:
            return
        self.has_reported = True
        gc.set_threshold(GC_THRESHOLD_OBJECTS, *self._collected_after[1:])
        self._report(0.0)
        if self._lock is not None and not self._joined:
            self._lock.acquire(self._report)

    def on_end(self, event: Event) -> None:
        """The compiler has ended with a kernel."""
        assert event.data is not None
        function = event.data["dispatcher"].py_func
        if not function.__module__.startswith(KERNEL_PACKAGE_PREFIX):
            return  # one of the compiler's own
        compiled_bytes = len(function.__code__.co_code)
        self._compiled_bytes += compiled_bytes
        if self._lock is not None:
            self._lock.add(compiled_bytes)
        self.report()

    def report(self) -> None:
        """Report how far all processes that compile together are."""
        own_fraction = fraction_of(self._compiled_bytes)
        self._report(
            own_fraction if self._lock is None else max(own_fraction, self._lock.fraction())
        )

    def _report(self, fraction: float) -> None:
        self._progress(Progress(stage="read", fraction=fraction, message=COMPILING))


def beside(part: str, directory: Path | None) -> subprocess.Popen[bytes]:
    """Warm up in another process, which ends as soon as this one has, however it ends.

    Args:
        part: ``paths``, ``paths-and-motions``, ``turns``, or ``all``, which has a low priority.
        directory: Directory of the locks; beside the compiled kernels if None.
    """
    place = [] if directory is None else [str(directory)]
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "foldback.planner.pipeline.warm_up", part, *place],
        stdin=subprocess.PIPE,
    )

    def close_in_fork() -> None:
        assert process.stdin is not None
        process.stdin.close()

    # A fork of this process shall not keep the pipe open. This also keeps the process from being
    # dropped while it runs.
    os.register_at_fork(after_in_child=close_in_fork)
    return process


@contextmanager
def second_process(part: str, directory: Path, compiling: Compiling) -> Generator[None]:
    """Compile a part in another process, and wait for it at the end."""
    process = beside(part, directory)
    yield
    while process.poll() is None:
        compiling.report()
        time.sleep(LOCK_POLL_S)


def end_with_parent() -> None:
    """End this process at the end of its standard input: then its parent is gone."""

    def watch() -> None:
        while os.read(0, 1):
            pass
        os._exit(1)

    threading.Thread(target=watch, name="parent", daemon=True).start()
