"""Shipped pictures: drawings that come with the package, made by ``examples/make_pictures.py``.

Pages show them without computing anything. The test of that script draws them again and compares.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Final
from zipfile import ZipFile

ARCHIVE: Final = Path(__file__).parents[1] / "pictures.zip"


@cache
def shipped_pictures() -> dict[str, bytes]:
    """Return the files of ``ARCHIVE`` by name."""
    with ZipFile(ARCHIVE) as archive:
        return {name: archive.read(name) for name in archive.namelist()}
