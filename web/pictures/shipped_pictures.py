"""Shipped pictures: drawings that come with the package, made by ``examples/make_pictures.py``.

Pages show them without computing anything. The test of that script draws them again and compares.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Final
from zipfile import ZipFile

ARCHIVE: Final = Path(__file__).parents[1] / "pictures.zip"
MOTIONS_ARCHIVE: Final = Path(__file__).parents[1] / "motions.zip"
"""Archive of moving drawings of folds, made by ``examples/make_motions.py``."""


@cache
def shipped_pictures() -> dict[str, bytes]:
    """Return the files of ``ARCHIVE`` by name."""
    with ZipFile(ARCHIVE) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def shipped_motion(shape_name: str) -> bytes | None:
    """Return the moving drawing of an example shape; None if there is none."""
    with ZipFile(MOTIONS_ARCHIVE) as archive:
        file_name = f"{shape_name}.svg"
        return archive.read(file_name) if file_name in archive.NameToInfo else None
