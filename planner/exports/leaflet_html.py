"""Leaflet as one HTML file, for screens and printers: no scripts, and nothing from elsewhere."""

from __future__ import annotations

from html import escape
from itertools import groupby
from typing import Final

from foldback.planner.exports.leaflet import HEAD_MM, LEGEND, PAGE_MM, LeafletStep, leaflet_of
from foldback.planner.exports.step_drawing import (
    INKS,
    MAX_SCALE_MM,
    Drawing,
    Ink,
    Shape,
    line_width,
    radius_of,
)
from foldback.planner.plan.plan import Plan

END: Final = ' text-anchor="end"'
UNITS: Final = 20.0
"""Units of a drawing's coordinates for a pitch; they are whole numbers."""
POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
"""Content security policy of the page: no scripts, nothing is loaded, and nothing is sent."""
STYLE: Final = """\
@page {
  margin: 14mm;
  @bottom-right { content: counter(page) " / " counter(pages); font-size: 8pt; }
}
:root { color-scheme: light; }
body {
  max-width: 182mm; margin: 0 auto; padding: 8mm 4mm; background: #fff; color: #000;
  font: 10.5pt/1.4 system-ui, sans-serif;
}
h1 { margin: 0; font-size: 24pt; line-height: 1.2; overflow-wrap: anywhere; }
header { break-after: page; }
header > svg { display: block; margin: 6mm auto; max-width: 100%; }
.legend { display: flex; flex-wrap: wrap; gap: 2mm 6mm; padding: 0; list-style: none; }
.legend svg { width: 4mm; height: 4mm; margin-right: 1.5mm; vertical-align: -0.7mm; }
.steps { display: grid; gap: 5mm 6mm; margin: 0; padding: 0; list-style: none; }
.steps li {
  display: flex; flex-direction: column; min-width: 0; padding-top: 1.5mm; break-inside: avoid;
  border-top: 0.2mm solid #bbb; font-size: 9pt;
}
.steps p { margin: 0; }
.steps b { margin-right: 1.5mm; font-size: 14pt; line-height: 1; }
.steps svg { margin: auto; max-width: 100%; overflow: visible; }
svg { stroke-linejoin: round; }
svg text { paint-order: stroke; stroke: #fff; stroke-width: 0.3em; }
@media (max-width: 600px) { .steps { grid-template-columns: 1fr !important; } }
@media print {
  body { max-width: none; padding: 0; }
  .high li { height: 242mm; }
  .high svg { min-height: 0; }
}
"""
"""Style of the page: black on white, also on dark screens, as it is printed."""


def write(plan: Plan) -> bytes:
    """Return the leaflet of a plan as one HTML file.

    Raises:
        InputError: ``no-frames``, or ``no-steps`` if the plan does not rest between steps.
    """
    leaflet = leaflet_of(plan)
    (columns, rows), (width, height) = leaflet.layout, PAGE_MM
    gap = 6.0
    cell = (width - gap * (columns - 1)) / columns, height / rows - HEAD_MM
    hints = "".join(f"<li>{escape(hint)}</li>" for hint in leaflet.hints)
    steps = "".join(_step(step, cell) for step in leaflet.steps)
    title = escape(leaflet.title)
    kind = "steps high" if rows == 1 else "steps"
    return (
        '<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        f"<title>{title}</title>\n<style>\n{STYLE}"
        f".steps {{ grid-template-columns: repeat({columns}, 1fr); }}\n</style>\n"
        f"<header>\n<h1>{title}</h1>\n<p>{escape(leaflet.summary)}</p>\n"
        f"{_svg(leaflet.shape, (width, 0.5 * height), 9.0, f'The folded shape: {title}')}\n"
        f"<ol>{hints}</ol>\n{_legend()}\n</header>\n"
        f'<ol class="{kind}">\n{steps}</ol>\n</html>\n'
    ).encode()


def _step(step: LeafletStep, cell: tuple[float, float]) -> str:
    drawing = _svg(step.drawing, cell, MAX_SCALE_MM)
    return f"<li><p><b>{step.number}</b>{escape(step.text)}</p>{drawing}</li>\n"


def _legend() -> str:
    rows: list[str] = []
    for sample, word in LEGEND:
        drawn = _drawn([sample], 4.0)
        svg = f'<svg viewBox="0 0 {UNITS:g} {UNITS:g}" aria-hidden="true">{drawn}</svg>'
        rows.append(f"<li>{svg}{word}</li>")
    return f'<ul class="legend">{"".join(rows)}</ul>'


def _svg(drawing: Drawing, size_mm: tuple[float, float], max_mm: float, title: str = "") -> str:
    """Return a drawing as SVG that fits into a width and a height."""
    left, top, right, bottom = drawing.box
    wide, tall = right - left, bottom - top
    scale = min(size_mm[0] / wide, size_mm[1] / tall, max_mm)
    box = " ".join(f"{UNITS * value:.0f}" for value in (left, top, wide, tall))
    name = f'role="img" aria-label="{title}"' if title else 'aria-hidden="true"'
    return (
        f'<svg viewBox="{box}" style="width:{scale * wide:.1f}mm" {name}>'
        f"{_drawn(drawing.shapes, scale)}</svg>"
    )


def _drawn(shapes: tuple[Shape, ...] | list[Shape], scale_mm: float) -> str:
    parts: list[str] = []
    for style, group in groupby(shapes, key=lambda shape: shape.style):
        ink = INKS[style]
        members = list(group)
        paint = _paint(ink, scale_mm)
        if style == "label":
            size = UNITS * 2.4 / scale_mm
            parts += [
                f'<text x="{UNITS * x:.0f}" y="{UNITS * y:.0f}" font-size="{size:.0f}"'
                f"{END if shape.ends else ''}>"
                f"{escape(shape.text)}</text>"
                for shape in members
                for x, y in shape.points
            ]
        elif members[0].radius:
            parts += [
                f'<circle cx="{UNITS * x:.0f}" cy="{UNITS * y:.0f}" '
                f'r="{UNITS * radius_of(shape, scale_mm) / scale_mm:.0f}" {paint}/>'
                for shape in members
                for x, y in shape.points
            ]
        else:
            lines = "".join(_path(shape) for shape in members)
            parts.append(f'<path {paint} d="{lines}"/>')
    return "".join(parts)


def _paint(ink: Ink, scale_mm: float) -> str:
    fill = "none" if ink.fill is None else _grey(ink.fill)
    if ink.line is None:
        return f'fill="{fill}"'
    width = UNITS * line_width(ink, scale_mm) / scale_mm
    dash = f' stroke-dasharray="{UNITS * ink.dash:.0f}"' if ink.dash else ""
    return f'fill="{fill}" stroke="{_grey(ink.line)}" stroke-width="{width:.1f}"{dash}'


def _grey(tone: float) -> str:
    return "#" + 3 * f"{round(255 * tone):02x}"


def _path(shape: Shape) -> str:
    points = [(round(UNITS * x), round(UNITS * y)) for x, y in shape.points]
    steps = "".join(
        f"l{c - a} {d - b}" for (a, b), (c, d) in zip(points[:-1], points[1:], strict=True)
    )
    return f"M{points[0][0]} {points[0][1]}{steps}{'z' if shape.closed else ''}"
