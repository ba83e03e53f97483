"""Names: what people call a chain, fit for any file. Names come from strangers."""

from __future__ import annotations

from typing import Final

LONGEST: Final = 100


def clean_name(name: str) -> str:
    """A name without anything that does not print, nor what XML cannot hold; ``fold`` if empty."""
    printing = "".join(c if c.isprintable() else " " for c in name)
    return " ".join(printing.split())[:LONGEST].rstrip() or "fold"
