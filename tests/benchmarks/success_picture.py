"""The success map as a picture: a field for each method and kind of path, a bar for each size."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Final

SIDE: Final = 20
GAP: Final = 3
LEFT: Final = 96
TOP: Final = 64
NONE: Final = "#e9e7e2"
BAD: Final = (201, 72, 60)
GOOD: Final = (43, 132, 94)

Shares = dict[tuple[str, str, int], tuple[int, int]]


def picture(
    shares: Shares, methods: Sequence[str], kinds: Sequence[str], sizes: Sequence[int]
) -> str:
    """SVG: columns are methods and sizes, rows are kinds of path; green is verified.

    Args:
        shares: By method, kind and modules: how many are verified, and of how many.
        methods, kinds, sizes: In the order in which they are drawn.
    """
    field = len(sizes) * SIDE + 3 * GAP
    width = LEFT + len(methods) * field + 16
    height = TOP + len(kinds) * (SIDE + GAP) + 56
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'width="{width}" height="{height}" font-family="system-ui, sans-serif" font-size="12" '
        'fill="#2a2e35">',
        "<title>Share of verified folds by method, kind of path and number of modules</title>",
        f'<rect width="{width}" height="{height}" fill="#faf9f7"/>',
    ]
    for column, method in enumerate(methods):
        x = LEFT + column * field
        parts.append(f'<text x="{x}" y="{TOP - 34}" font-weight="600">{escape(method)}</text>')
        for place, size in enumerate(sizes):
            middle = x + place * SIDE + SIDE / 2
            parts.append(
                f'<text transform="translate({middle + 3} {TOP - 6}) rotate(-60)" font-size="9" '
                f'fill="#6b7078">{size}</text>'
            )
            for row, kind in enumerate(kinds):
                parts.append(_cell(shares.get((method, kind, size)), x + place * SIDE, row))
    for row, kind in enumerate(kinds):
        y = TOP + row * (SIDE + GAP) + SIDE / 2 + 4
        parts.append(f'<text x="{LEFT - 10}" y="{y}" text-anchor="end">{escape(kind)}</text>')
    parts.append(_key(height - 26))
    parts.append("</svg>\n")
    return "\n".join(parts)


def _cell(share: tuple[int, int] | None, x: float, row: int) -> str:
    y = TOP + row * (SIDE + GAP)
    fill = NONE if share is None else _colour(share[0] / share[1])
    told = "not run" if share is None else f"{share[0]} of {share[1]} verified"
    return (
        f'<rect x="{x}" y="{y}" width="{SIDE - 1}" height="{SIDE}" rx="2" fill="{fill}">'
        f"<title>{told}</title></rect>"
    )


def _key(y: float) -> str:
    parts: list[str] = []
    x = float(LEFT)
    for fill, text in (
        (_colour(1.0), "all verified"),
        (_colour(0.5), "some"),
        (_colour(0.0), "none"),
        (NONE, "not run"),
    ):
        parts.append(f'<rect x="{x}" y="{y}" width="12" height="12" rx="2" fill="{fill}"/>')
        parts.append(f'<text x="{x + 18}" y="{y + 10}">{text}</text>')
        x += 36 + 7 * len(text)
    return "".join(parts)


def _colour(share: float) -> str:
    mixed = (round(b + share * (g - b)) for b, g in zip(BAD, GOOD, strict=True))
    return "#" + "".join(f"{value:02x}" for value in mixed)
