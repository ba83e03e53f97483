"""Citation of a fold as BibTeX, with the paper whose method foldback implements."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Final

from foldback.words.fold import ShownFold

PAPER_TITLE: Final = (
    "Folding Arbitrary 3D Shapes with Space Filling Chain Robots: Reverse Explosion Approach to "
    "Folding Sequence Design"
)
"""Title of the paper whose method foldback implements."""
PAPER_ENTRY: Final = f"""@misc{{reverse-explosion,
  title = {{{{{PAPER_TITLE}}}}},
  note = {{The method that foldback implements}},
}}
"""
AUTHOR: Final = "foldback contributors"
"""Author of foldback, as in CITATION.cff."""


def bibtex(row: ShownFold, *, address: str, version: str | None) -> str:
    """Return the BibTeX entries of a fold and of the paper.

    Args:
        row: Facts of the fold.
        address: Address of its page.
        version: Version of foldback that computed it; None if unknown.
    """
    title = f"{row.title}: a folding motion of {row.counted}"
    software = f"foldback {version}" if version else "foldback"
    fields = {"title": f"{{{_escaped(title)}}}", "author": f"{{{AUTHOR}}}"}
    note = f"Computed with {software}"
    if row.created_at is not None:
        day = datetime.fromtimestamp(row.created_at, UTC).date()
        fields |= {"year": f"{day.year}"}
        note = f"Computed on {day.isoformat()} with {software}"
    fields |= {"howpublished": f"\\url{{{address.translate(_URL_SIGNS)}}}", "note": _escaped(note)}
    lines = "".join(f"  {name} = {{{value}}},\n" for name, value in fields.items())
    return f"@misc{{foldback-{row.id[:8]},\n{lines}}}\n\n{PAPER_ENTRY}"


_TEX_SIGNS: Final = str.maketrans(
    {
        **{sign: f"\\{sign}" for sign in "&%$#_"},
        "\\": r"\textbackslash ",
        "~": r"\textasciitilde ",
        "^": r"\textasciicircum ",
        "{": r"\textbraceleft ",
        "}": r"\textbraceright ",
    }
)
"""What stands for signs with a meaning in TeX; BibTeX counts braces even after a backslash."""
_URL_SIGNS: Final = str.maketrans({sign: f"%{ord(sign):02X}" for sign in "\\{}"})
"""What stands for signs that would end the command of an address."""


def _escaped(text: str) -> str:
    """Return a text in which no sign has a meaning in TeX or BibTeX."""
    return text.translate(_TEX_SIGNS)
