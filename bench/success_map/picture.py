"""The success map as a picture: a field for each method, in it a row for each kind of path.

What is verified is told by how far a cell is filled and by a cross where nothing is, colours apart:
from below what was simulated, on it what was verified by kinematics only.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Final

SIDE: Final = 24
LEFT: Final = 76
GAP: Final = 18
FIELDS_A_ROW: Final = 4
HEAD: Final = 64
"""Above the cells of a field: its name and the numbers of modules."""
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

Share = tuple[int, int, int]
"""Folds that are verified and simulated, that are verified by kinematics only, and all of them."""
Shares = dict[tuple[str, str, int], Share]


def picture(
    shares: Shares, methods: Sequence[str], kinds: Sequence[str], sizes: Sequence[int]
) -> str:
    """SVG: a field for each method, in it kinds of path from above and sizes from the left.

    Args:
        shares: By method, kind and modules: how many are verified in each way, and of how many.
        methods, kinds, sizes: In the order in which they are drawn.
    """
    wide = len(sizes) * SIDE + GAP
    tall = HEAD + len(kinds) * SIDE + GAP
    columns = min(FIELDS_A_ROW, len(methods))
    width = LEFT + columns * wide + 8
    # The key takes the place behind the last field, or a row of its own.
    height = (len(methods) // columns + 1) * tall + 8
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'width="{width}" height="{height}" role="img">',
        "<title>Share of verified folds by method, kind of path and number of modules</title>",
        f"<style>{STYLE}</style>",
        f'<rect class="ground" width="{width}" height="{height}"/>',
    ]
    for number, method in enumerate(methods):
        x, y = LEFT + number % columns * wide, number // columns * tall
        parts.append(_field(shares, method, kinds, sizes, x, y))
        if number % columns == 0:
            parts += [
                f'<text x="{LEFT - 8}" y="{y + HEAD + row * SIDE + 16}" text-anchor="end">'
                f"{escape(kind)}</text>"
                for row, kind in enumerate(kinds)
            ]
    place = len(methods)
    parts.append(_key(LEFT + place % columns * wide, place // columns * tall + HEAD))
    parts.append("</svg>\n")
    return "\n".join(parts)


def _field(
    shares: Shares, method: str, kinds: Sequence[str], sizes: Sequence[int], x: int, y: int
) -> str:
    parts = [f'<text class="name" x="{x}" y="{y + 20}">{escape(method)}</text>']
    for place, size in enumerate(sizes):
        left = x + place * SIDE
        parts.append(
            f'<text class="size" transform="translate({left + 13} {y + HEAD - 6}) rotate(-50)">'
            f"{size}</text>"
        )
        for row, kind in enumerate(kinds):
            share = shares.get((method, kind, size))
            told = _told(share)
            cell = _cell(share, left, y + HEAD + row * SIDE)
            parts.append(f"<g><title>{told}</title>{cell}</g>")
    return "\n".join(parts)


def _told(share: Share | None) -> str:
    if share is None:
        return "not run"
    simulated, by_kinematics, count = share
    if not by_kinematics:
        return f"{simulated} of {count} verified" + (" (simulated)" if simulated else "")
    if not simulated:
        return f"{by_kinematics} of {count} verified (kinematics only)"
    return f"{simulated} of {count} verified (simulated), {by_kinematics} (kinematics only)"


def _cell(share: Share | None, x: float, y: float) -> str:
    """A cell that is filled from below as far as folds are verified; a cross where none is."""
    side = SIDE - 3
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
    told: tuple[tuple[Share | None, str], ...] = (
        ((1, 0, 1), "verified, simulated"),
        ((0, 1, 1), "kinematics only"),
        ((1, 0, 2), "some"),
        ((0, 0, 1), "none"),
        (None, "not run"),
    )
    return "\n".join(
        f'{_cell(share, x, y + k * (SIDE + 4))}<text x="{x + 30}" y="{y + k * (SIDE + 4) + 15}">'
        f"{text}</text>"
        for k, (share, text) in enumerate(told)
    )
