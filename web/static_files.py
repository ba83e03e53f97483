"""Static files: the scripts, styles and pictures of pages, and which scripts import which."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path, PurePosixPath
from posixpath import normpath
from typing import Final

STATIC: Final = Path(__file__).parent / "static"
IMPORT: Final = re.compile(r'(\bfrom\s+|\bimport\s+)"(\.{1,2}/[a-z_/]+\.js)"')
"""A static import: the words before the address, and the address."""


def text_of(name: str) -> str:
    """The text of a file, by its path below ``static``."""
    return (STATIC / name).read_text(encoding="utf-8")


def imported(name: str, address: str) -> str:
    """The path of the script that ``name`` imports from a relative address."""
    return normpath(str(PurePosixPath(name).parent / address))


@cache
def scripts_of(entry: str) -> tuple[str, ...]:
    """The paths of all scripts that one needs, itself first, none twice."""
    found = [entry]
    for name in found:
        addresses = (match[2] for match in IMPORT.finditer(text_of(name)))
        found += [
            path
            for path in dict.fromkeys(imported(name, a) for a in addresses)
            if path not in found
        ]
    return tuple(found)
