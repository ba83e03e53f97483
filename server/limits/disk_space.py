"""Disk space: free bytes, and the minimum that the service leaves free."""

from __future__ import annotations

import shutil
from pathlib import Path

from foldback.server.errors import no_room


def free_space(path: Path) -> int:
    """Return the number of free bytes on the disk of a path."""
    return shutil.disk_usage(path).free


def check_space(path: Path, min_free_bytes: int, *, needed: int = 0) -> None:
    """Check that a disk has its minimum of free space.

    Args:
        path: Path on the disk.
        min_free_bytes: Minimum of free space, bytes.
        needed: Number of bytes that will be written.

    Raises:
        NoRoom: If the disk has too little free space.
        OSError: If the path cannot be examined.
    """
    if free_space(path) < min_free_bytes + needed:
        raise no_room("The disk of the service is nearly full; try again later.")
