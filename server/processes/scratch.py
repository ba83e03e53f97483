"""Scratch directories of computations; those of ended processes are removed."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from fcntl import LOCK_EX, LOCK_NB, flock
from pathlib import Path
from typing import Any, Final

from foldback.planner.storage.file_names import REQUEST

MOTORS_FILE: Final = "motors"
"""Name of the file with the table of motor torques in the scratch directory of a task that computes
them."""
MOMENT_FILE: Final = "moment.json"
"""Name of the file with caption, camera and frame of the motion in the scratch directory of a task
that draws a chain's picture."""
READ_CONTENT: Final = "read.json"
"""Name of the file, in the directory of a preview's options, that states what was read from the
upload; it exists once the upload was read."""
PICTURE: Final = "picture.png"
"""Name of the drawn picture in the scratch directory of a task that draws a chain's picture."""


class Scratch:
    """Parent of scratch directories. Several processes may share one.

    Each directory is locked as long as its process runs.

    Args:
        root: Directory that contains them and nothing else.
    """

    def __init__(self, root: Path) -> None:
        self._root = root

    @contextmanager
    def directory(self) -> Generator[Path]:
        """Create a directory that is removed at the end of the context.

        Raises:
            OSError: If the disk is full.
        """
        self._root.mkdir(parents=True, exist_ok=True)
        with _locked(self._root):
            path = Path(tempfile.mkdtemp(dir=self._root))
            lock = os.open(path, os.O_RDONLY)
            flock(lock, LOCK_EX)
        try:
            yield path
        finally:
            shutil.rmtree(path, ignore_errors=True)
            os.close(lock)

    def sweep(self) -> None:
        """Remove directories of ended processes."""
        if not self._root.is_dir():
            return
        with _locked(self._root):
            for leftover in list(self._root.iterdir()):
                if leftover.is_symlink() or not leftover.is_dir():
                    leftover.unlink(missing_ok=True)
                    continue
                try:
                    with _locked(leftover, at_once=True):
                        shutil.rmtree(leftover, ignore_errors=True)
                except OSError:  # it is in use, or has just been removed
                    continue


@contextmanager
def _locked(path: Path, *, at_once: bool = False) -> Generator[None]:
    """Hold the lock of a directory; raise BlockingIOError if another process holds it."""
    handle = os.open(path, os.O_RDONLY)
    try:
        flock(handle, LOCK_EX | (LOCK_NB if at_once else 0))
        yield
    finally:
        os.close(handle)


def request_in(directory: Path) -> dict[str, Any]:
    """Return the request of the computation in a directory."""
    return json.loads((directory / REQUEST).read_bytes())
