"""Downloads: answers that become files, whole or not at all."""

from __future__ import annotations

import os
import secrets
from pathlib import Path

import httpx

Place = str | os.PathLike[str]


def save(answer: httpx.Response, to: Path, filename: str) -> Path:
    """Write an answer to a temporary file, and rename it when it is complete.

    Args:
        answer: Whose content is still to come.
        to: The file, or a directory that is there.
        filename: Name of the file in a directory.
    """
    path = to / Path(filename).name if to.is_dir() else to
    aside = path.with_name(f".{path.name[:100]}.{secrets.token_hex(4)}.part")
    try:
        with open(aside, "xb") as file:
            for piece in answer.iter_bytes():
                file.write(piece)
            file.flush()
            os.fsync(file.fileno())
        os.replace(aside, path)
    finally:
        aside.unlink(missing_ok=True)
    return path
