"""Lock of the compilation: one process compiles at a time, and a file shows how far it is.

Nothing here needs the compiler, so that the web process can look at the file.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

if sys.platform != "win32":
    from fcntl import LOCK_EX, LOCK_NB, LOCK_SH, flock

FIRST_LOCK: Final = "compiling-first.lock"
"""Name of the lock file for compiling the kernels (numba functions) that a first fold needs; it
keeps two processes from compiling the same kernels."""
PATHS_LOCK: Final = "compiling-paths.lock"
"""Name of the lock file for compiling the kernels (numba functions) that find paths; it keeps two
processes from compiling the same kernels."""
REST_LOCK: Final = "compiling-rest.lock"
"""Name of the lock file for compiling the kernels (numba functions) that a first fold does not
need; it keeps two processes from compiling the same kernels."""
FIRST_KERNELS_BYTES: Final = 83_000
"""Total size of the Python bytecode of the kernels (numba functions) that a first fold needs, in
bytes; compiled bytes divided by it are the displayed progress. With too large a value compilation
finishes before progress reaches 100 %; with too small a one progress waits near 100 %. Measured; a
test compares it."""
IMPORTS_FRACTION: Final = 0.1
"""Fraction of the time until the kernels are ready that has passed when the first kernel (numba
function) is compiled, mostly for imports. Measured: 0.08 to 0.1."""
MAX_COMPILED_FRACTION: Final = 0.95
"""Largest progress, from 0 to 1, that is reported while kernels are compiled; 1 is reported only at
the end. The last kernels contain many others and take longer than their bytecode suggests.
Measured: 0.9 to 0.95."""
MAX_LOCK_WAIT_S: Final = 300.0
"""Time, in s, after which a process compiles kernels (numba functions) although another process
holds the lock for it. A smaller value makes two processes compile the same kernels. Compilation
takes less on the slowest machine tried."""
LOCK_POLL_S: Final = 0.2
"""Time, in s, between two attempts to acquire the lock for compiling kernels (numba functions)."""


def fraction_of(compiled_bytes: int) -> float:
    """Return the fraction of the first start after so many compiled bytes of bytecode."""
    if not compiled_bytes:
        return 0.0
    compiled = min(compiled_bytes / FIRST_KERNELS_BYTES, 1.0)
    return IMPORTS_FRACTION + (MAX_COMPILED_FRACTION - IMPORTS_FRACTION) * compiled


class CompilingLock:
    """A lock file of this user alone; its length is the bytecode that was compiled under it.

    Where there are no such locks (Windows), or the file belongs to somebody else, nothing waits,
    and two processes may compile the same kernels.

    Args:
        path: The file. Its directory is made where it is missing.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: int | None = None

    def acquire(self, waiting: Callable[[float], None]) -> None:
        """Wait for the lock for up to ``MAX_LOCK_WAIT_S``, then empty the file.

        Args:
            waiting: Called now and then with the fraction of whoever holds the lock.
        """
        self._file = _open(self._path, create=True)
        if self._file is None or sys.platform == "win32":
            return
        deadline = time.monotonic() + MAX_LOCK_WAIT_S
        while time.monotonic() < deadline:
            with suppress(OSError):
                flock(self._file, LOCK_EX | LOCK_NB)
                os.ftruncate(self._file, 0)
                return
            waiting(fraction_of(os.fstat(self._file).st_size))
            time.sleep(LOCK_POLL_S)

    def add(self, compiled_bytes: int) -> None:
        """Note that so much bytecode was compiled, here or in a process beside."""
        if self._file is None:
            self._file = _open(self._path, create=True)
        if self._file is not None:
            with suppress(OSError):  # a full disk: only the figure stands still
                os.write(self._file, b"." * compiled_bytes)

    def fraction(self) -> float:
        """Return how far the compilation is, 0 to ``MAX_COMPILED_FRACTION``."""
        return 0.0 if self._file is None else fraction_of(os.fstat(self._file).st_size)

    def release(self) -> None:
        """Let other processes go on."""
        if self._file is not None:
            os.close(self._file)
            self._file = None


def compiling_fraction(directory: Path) -> float | None:
    """Return how far the first compilation under a directory is; None when none goes on."""
    file = _open(directory / FIRST_LOCK, create=False)
    if file is None or sys.platform == "win32":
        return None
    try:
        flock(file, LOCK_SH | LOCK_NB)
    except OSError:
        return fraction_of(os.fstat(file).st_size)
    finally:
        os.close(file)
    return None


def _open(path: Path, *, create: bool) -> int | None:
    """Return a descriptor of a file that nobody else may open; None where there is none."""
    if sys.platform == "win32":
        return None
    flags = os.O_RDWR | os.O_APPEND | os.O_NOFOLLOW | (os.O_CREAT if create else 0)
    try:
        if create:
            path.parent.mkdir(parents=True, exist_ok=True)
        file = os.open(path, flags, 0o600)
    except OSError:
        return None
    if os.fstat(file).st_uid != os.getuid():
        os.close(file)
        return None
    os.fchmod(file, 0o600)
    return file
