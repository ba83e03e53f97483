"""Downloads: responses that are written to files atomically."""

from __future__ import annotations

import os
import secrets
from pathlib import Path

import httpx

Place = str | os.PathLike[str]


def save(answer: httpx.Response, to: Path, filename: str) -> Path:
    """Write a response to a temporary file, and rename it when it is complete.

    Args:
        answer: Response whose content has not been read yet.
        to: The file, or an existing directory.
        filename: Name of the file if ``to`` is a directory.
    """
    path = to / Path(filename).name if to.is_dir() else to
    partial_path = path.with_name(f".{path.name[:100]}.{secrets.token_hex(4)}.part")
    try:
        with open(partial_path, "xb") as file:
            for piece in answer.iter_bytes():
                file.write(piece)
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial_path, path)
    finally:
        partial_path.unlink(missing_ok=True)
    return path
