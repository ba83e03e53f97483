"""Files that are either whole or not there."""

from __future__ import annotations

import os
from pathlib import Path as FilePath


def write_whole(path: FilePath, data: bytes) -> None:
    """Writes a file that is either whole or not there."""
    aside = path.with_name(f".{path.name}.{os.getpid()}")
    aside.write_bytes(data)
    aside.replace(path)
