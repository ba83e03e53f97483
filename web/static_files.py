"""Static files: the scripts, styles and pictures of pages, and which scripts import which."""

from __future__ import annotations

import re
from functools import cache
from hashlib import sha256
from pathlib import Path, PurePosixPath
from posixpath import normpath
from typing import Final

STATIC: Final = Path(__file__).parent / "static"
SCRIPT_IMPORT: Final = re.compile(r'(\bfrom |\bimport |\bimport\()"(\.{1,2}/[a-z_/]+\.js)"')
"""Matches an import of another script in formatted JavaScript without comments; the groups are the
words before the address (``import(`` loads the script on first use) and the address."""


def text_of(name: str) -> str:
    """Return the text of a file, by its path below ``static``."""
    return (STATIC / name).read_text(encoding="utf-8")


VERSIONED: Final = "version"
"""First directory in the addresses of scripts; the second one is their version, so that browsers
may cache them indefinitely."""
COMMENTS: Final = re.compile(
    r"^[ \t]*(?:/\*\*(?:(?!\*/).)*\*/|//[^\n]*)[ \t]*\n|/\*\* @(?:(?!\*/).)*\*/ ?",
    re.MULTILINE | re.DOTALL,
)
"""Matches comment lines of a script, and type annotations within lines; they are removed before
the script is sent."""


def code_of(name: str) -> str:
    """Return a script without its comments and types, which are a quarter of its size."""
    return COMMENTS.sub("", text_of(name))


@cache
def scripts_version() -> str:
    """Return the digest of all scripts, which is part of the addresses under which pages load them.

    Modules import each other by relative addresses, so all modules of a page have one version.
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
    """Return the paths of a script and of all scripts that it imports, each once.

    Args:
        entry: Path of the script, which comes first.
        later: True to include scripts that are loaded on first use.
    """
    names = [entry]
    for name in names:
        matches = SCRIPT_IMPORT.finditer(code_of(name))
        addresses = (match[2] for match in matches if later or match[1] != "import(")
        paths = dict.fromkeys(imported(name, address) for address in addresses)
        names += [path for path in paths if path not in names]
    return tuple(names)
