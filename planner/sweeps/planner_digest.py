"""Digest of the planner: two programs with the same one compute the same folds."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Final

from foldback.planner.parameters.option import OPTIONS_KEY_CHARS

PLANNER_SUFFIXES: Final = (".py", ".cpp", ".hpp", ".json")
"""Suffixes of the files of the planner that its digest covers."""


@cache
def planner_digest() -> str:
    """Return a digest of the planner's files and version, without those of sweeps."""
    planner = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256(version("foldback").encode())
    for path in sorted(planner.rglob("*")):
        name = path.relative_to(planner)
        if path.suffix in PLANNER_SUFFIXES and name.parts[0] != Path(__file__).parent.name:
            digest.update(f"{name.as_posix()}\0".encode() + path.read_bytes())
    return digest.hexdigest()[:OPTIONS_KEY_CHARS]
