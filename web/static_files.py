"""Static files: the scripts, styles and pictures of pages, and which scripts import which."""

from __future__ import annotations

import re
from functools import cache
from hashlib import sha256
from pathlib import Path, PurePosixPath
from posixpath import normpath
from typing import Final

STATIC: Final = Path(__file__).parent / "static"
SCRIPT_IMPORT: Final = re.compile(
    r'(\bfrom\s+|\bimport\s+|\bimport\()"(\.{1,2}/[a-z_/]+\.js)"(?!\)\.[A-Z])'
)
"""Pattern of an import in a script, except of types: the words before the address, and the address.
``import(`` loads a module on first use."""


def text_of(name: str) -> str:
    """Return the text of a file, by its path below ``static``."""
    return (STATIC / name).read_text(encoding="utf-8")


VERSIONED: Final = "version"
"""Directory in addresses of scripts, before their version."""
COMMENT_LINES: Final = re.compile(
    r"^[ \t]*(?:/\*\*(?:(?!\*/).)*\*/|//[^\n]*)[ \t]*\n", re.MULTILINE | re.DOTALL
)
"""Pattern of lines of a script with nothing but a comment; ``/**`` comments hold types."""


def code_of(name: str) -> str:
    """Return a script without its comments, a quarter of it, which no browser needs."""
    return COMMENT_LINES.sub("", text_of(name))


@cache
def scripts_version() -> str:
    """Return the digest of all scripts, which is part of the addresses under which pages load them.

    Modules import each other by relative addresses, so that all of a page have the same version.
    """
    digest = sha256()
    for path in sorted((STATIC / "js").rglob("*.js")):
        name = path.relative_to(STATIC).as_posix()
        digest.update(f"{name}\n{code_of(name)}".encode())
    return digest.hexdigest()[:12]


def imported(name: str, address: str) -> str:
    """Return the path of the script that ``name`` imports from a relative address."""
    return normpath(str(PurePosixPath(name).parent / address))


@cache
def scripts_of(entry: str, *, later: bool = True) -> tuple[str, ...]:
    """Return the paths of all scripts that one needs, itself first, none twice.

    Args:
        entry: The one.
        later: True to include those that are loaded on first use.
    """
    found = [entry]
    for name in found:
        matches = SCRIPT_IMPORT.finditer(text_of(name))
        addresses = (match[2] for match in matches if later or match[1] != "import(")
        found += [
            path
            for path in dict.fromkeys(imported(name, a) for a in addresses)
            if path not in found
        ]
    return tuple(found)
