"""The success map as a picture: a field per method, with a row per kind of path.

A cell is filled in proportion to the verified folds, from below: first those that were simulated,
then those verified by kinematics only. A cross marks a cell without verified folds, so that the
picture is readable without colours.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Final

CELL_PX: Final = 24
"""Width and height of one cell of the success map's picture, with its margin, in SVG pixels. A cell
shows the verified fraction for one method, kind of path and number of modules."""
LABELS_PX: Final = 76
"""Width of the column at the left of the success map's picture, in SVG pixels, which holds the
names of the kinds of paths."""
GAP_PX: Final = 18
"""Width of the gap between the grids of two methods in the success map's picture, in SVG
pixels."""
FIELDS_PER_ROW: Final = 4
"""Maximum number of methods whose grids are drawn side by side in the success map's picture;
further ones begin a new row."""
HEAD_PX: Final = 64
"""Height of the heading above each method's grid in the success map's picture, in SVG pixels: the
method's name and the slanted numbers of modules."""
STYLE: Final = """
svg { background: #faf9f7; }
text { fill: #2a2e35; font: 12px system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; }
.name { font-weight: 600; font-size: 13px; }
.size { font-size: 10.5px; fill: #545a63; }
.ground { fill: #faf9f7; }
.cell { fill: #f3dcc0; }
.good { fill: #1f5f9e; }
.kinematics { fill: #a5c6e6; stroke: #1f5f9e; stroke-width: 1.5; }
.none { fill: none; stroke: #c9c5bc; }
.cross { stroke: #9a4a00; stroke-width: 2; }
@media (prefers-color-scheme: dark) {
  svg { background: #15181d; }
  text { fill: #eceef1; }
  .size { fill: #a3aab4; }
  .ground { fill: #15181d; }
  .cell { fill: #4a3620; }
  .good { fill: #62a8ea; }
  .kinematics { fill: #24425f; stroke: #62a8ea; }
  .none { stroke: #3a414b; }
  .cross { stroke: #ffb35c; }
}
"""
"""Styles of the picture, for light and dark pages."""

Share = tuple[int, int, int]
"""Number of folds verified by simulation, number verified by kinematics only, and number of all
folds."""
Shares = dict[tuple[str, str, int], Share]


def picture(
    shares: Shares, methods: Sequence[str], kinds: Sequence[str], sizes: Sequence[int]
) -> str:
    """Return the picture as SVG: a field for each method, with a row for each kind of path.

    Args:
        shares: Verified and all folds by method, kind and modules.
        methods, kinds, sizes: Order in which they are drawn.
    """
    wide = len(sizes) * CELL_PX + GAP_PX
    tall = HEAD_PX + len(kinds) * CELL_PX + GAP_PX
    columns = min(FIELDS_PER_ROW, len(methods))
    width = LABELS_PX + columns * wide + 8
    # The key follows the last field, in the same row if there is room.
    height = (len(methods) // columns + 1) * tall + 8
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'width="{width}" height="{height}" role="img">',
        "<title>Share of verified folds by method, kind of path and number of modules</title>",
        f"<style>{STYLE}</style>",
        f'<rect class="ground" width="{width}" height="{height}"/>',
    ]
    for number, method in enumerate(methods):
        x, y = LABELS_PX + number % columns * wide, number // columns * tall
        parts.append(_field(shares, method, kinds, sizes, x, y))
        if number % columns == 0:
            parts += [
                f'<text x="{LABELS_PX - 8}" y="{y + HEAD_PX + row * CELL_PX + 16}" '
                f'text-anchor="end">{escape(kind)}</text>'
                for row, kind in enumerate(kinds)
            ]
    index = len(methods)
    parts.append(_key(LABELS_PX + index % columns * wide, index // columns * tall + HEAD_PX))
    parts.append("</svg>\n")
    return "\n".join(parts)


def _field(
    shares: Shares, method: str, kinds: Sequence[str], sizes: Sequence[int], x: int, y: int
) -> str:
    parts = [f'<text class="name" x="{x}" y="{y + 20}">{escape(method)}</text>']
    for index, size in enumerate(sizes):
        x0 = x + index * CELL_PX
        parts.append(
            f'<text class="size" transform="translate({x0 + 13} {y + HEAD_PX - 6}) rotate(-50)">'
            f"{size}</text>"
        )
        for row, kind in enumerate(kinds):
            share = shares.get((method, kind, size))
            words = _words(share)
            cell = _cell(share, x0, y + HEAD_PX + row * CELL_PX)
            parts.append(f"<g><title>{words}</title>{cell}</g>")
    return "\n".join(parts)


def _words(share: Share | None) -> str:
    if share is None:
        return "not run"
    simulated, by_kinematics, count = share
    if not by_kinematics:
        return f"{simulated} of {count} verified" + (" (simulated)" if simulated else "")
    if not simulated:
        return f"{by_kinematics} of {count} verified (kinematics only)"
    return f"{simulated} of {count} verified (simulated), {by_kinematics} (kinematics only)"


def _cell(share: Share | None, x: float, y: float) -> str:
    """Draw a cell, filled in proportion to verified folds; with a cross if there are none."""
    side = CELL_PX - 3
    box = f'x="{x}" width="{side}" rx="3"'
    if share is None:
        return f'<rect class="none" {box} y="{y}" height="{side}"/>'
    parts = [f'<rect class="cell" {box} y="{y}" height="{side}"/>']
    below = 0.0
    for name, good in (("good", share[0]), ("kinematics", share[1])):
        if good:
            high = side * good / share[2]
            below += high
            parts.append(
                f'<rect class="{name}" {box} y="{y + side - below:.1f}" height="{high:.1f}"/>'
            )
    if not below:
        across = side - 12
        parts.append(
            f'<path class="cross" d="M{x + 6} {y + 6}l{across} {across}m{-across} 0l{across} '
            f'{-across}"/>'
        )
    return "".join(parts)


def _key(x: int, y: int) -> str:
    words: tuple[tuple[Share | None, str], ...] = (
        ((1, 0, 1), "verified, simulated"),
        ((0, 1, 1), "kinematics only"),
        ((1, 0, 2), "some"),
        ((0, 0, 1), "none"),
        (None, "not run"),
    )
    return "\n".join(
        f"{_cell(share, x, y + k * (CELL_PX + 4))}"
        f'<text x="{x + 30}" y="{y + k * (CELL_PX + 4) + 15}">{text}</text>'
        for k, (share, text) in enumerate(words)
    )
