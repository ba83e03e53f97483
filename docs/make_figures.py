"""Write the rows of a certificate's figures in certificate.md.

A test fails if it is outdated; run ``python -m docs.make_figures`` then.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from foldback.planner.certificate.figures import figures_of_certificates

PAGE: Final = Path(__file__).parent / "certificate.md"
BEGIN, END = "<!-- figures -->\n", "<!-- end of figures -->\n"


def markdown_rows() -> str:
    """Return the figures as rows in Markdown, one per line."""
    lines = [
        "| figure | label on pages | unit | computed from | meaning |",
        "|---|---|---|---|---|",
    ]
    for name, figure in figures_of_certificates().items():
        cells = (f"`{name}`", figure.label, figure.unit or "–", figure.source, figure.help)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def page(text: str) -> str:
    """Return a page with current rows."""
    before, _, after_begin = text.partition(BEGIN)
    _, _, after = after_begin.partition(END)
    return f"{before}{BEGIN}\n{markdown_rows()}\n{END}{after}"


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
