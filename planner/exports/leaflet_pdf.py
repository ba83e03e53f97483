"""Leaflet as PDF, on A4 or Letter paper: docs/decisions/0030-leaflet.md."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Final

from reportlab import rl_config
from reportlab.lib.pagesizes import A4, LETTER
from reportlab.lib.units import mm
from reportlab.lib.utils import simpleSplit
from reportlab.pdfbase import pdfmetrics
from reportlab.pdfbase.ttfonts import TTFont
from reportlab.pdfgen.canvas import Canvas

from foldback.planner.exports.export import FONT_FILE
from foldback.planner.exports.leaflet import LEGEND, Leaflet, LeafletStep, leaflet_of
from foldback.planner.exports.step_drawing import (
    INKS,
    MAX_SCALE_MM,
    Drawing,
    Shape,
    line_width,
    radius_of,
)
from foldback.planner.plan.plan import Plan

FONT: Final = "DejaVuSans"
MARGIN: Final = 14 * mm
"""Margin around a page, in points."""
FOOT: Final = 8 * mm
"""Height of the foot of a page, in points."""
TEXT_SIZE: Final = 8.5
"""Size of the text, in points."""
LINE_HEIGHT: Final = 1.25
"""Height of a line of text, relative to the size of its letters."""
LABEL_SIZE: Final = 7.0
"""Size of the numbers in drawings, in points."""
SAMPLE: Final = 4 * mm
"""Width of a sample in the legend, in points."""


def write(plan: Plan) -> bytes:
    """Return the leaflet of a plan for A4 paper.

    Raises:
        InputError: ``no-frames``, or ``no-steps`` if the plan does not rest between steps.
    """
    return _written(leaflet_of(plan), A4)


def write_letter(plan: Plan) -> bytes:
    """Return the leaflet of a plan for Letter paper; see ``write``."""
    return _written(leaflet_of(plan), LETTER)


@dataclass(frozen=True, slots=True)
class _Box:
    """Rectangle on a page, in points; y is that of its top, counted from below."""

    x: float
    y: float
    width: float
    height: float


def _written(leaflet: Leaflet, size: tuple[float, float]) -> bytes:
    rl_config.useA85 = 0  # binary streams are smaller
    pdfmetrics.registerFont(TTFont(FONT, str(FONT_FILE)))
    file = io.BytesIO()
    # Without times and random identifiers, the same plan gives the same file.
    canvas = Canvas(file, pagesize=size, invariant=1, pageCompression=1)
    canvas.setTitle(leaflet.title)
    canvas.setAuthor("foldback")
    canvas.setSubject(leaflet.summary)
    columns, rows = leaflet.layout
    per_page = columns * rows
    parts = [leaflet.steps[k : k + per_page] for k in range(0, len(leaflet.steps), per_page)]
    width, height = size
    _cover(canvas, leaflet, _Box(MARGIN, height - MARGIN, width - 2 * MARGIN, height - 2 * MARGIN))
    _end_page(canvas, leaflet, 1, len(parts) + 1, width)
    for number, part in enumerate(parts, 2):
        cell_width = (width - 2 * MARGIN) / columns
        cell_height = (height - 2 * MARGIN - FOOT) / rows
        for k, step in enumerate(part):
            row, column = divmod(k, columns)
            x, y = MARGIN + column * cell_width, height - MARGIN - row * cell_height
            _step(canvas, step, _Box(x + 4, y, cell_width - 8, cell_height))
        _end_page(canvas, leaflet, number, len(parts) + 1, width)
    canvas.save()
    return file.getvalue()


def _end_page(canvas: Canvas, leaflet: Leaflet, number: int, pages: int, width: float) -> None:
    canvas.setFillGray(0.3)
    canvas.setFont(FONT, LABEL_SIZE)
    canvas.drawString(MARGIN, MARGIN - 4 * mm, leaflet.title[:80])
    canvas.drawRightString(width - MARGIN, MARGIN - 4 * mm, f"Page {number} of {pages}")
    canvas.showPage()


def _cover(canvas: Canvas, leaflet: Leaflet, box: _Box) -> None:
    y = _text(canvas, leaflet.title, box, 24, lines=2)
    y = _text(canvas, leaflet.summary, _Box(box.x, y - 4, box.width, 0), 12, lines=2)
    bottom = box.y - 0.58 * box.height
    _drawing(canvas, leaflet.shape, _Box(box.x, y - 10, box.width, y - 10 - bottom), 9.0)
    y = bottom - 14
    for k, hint in enumerate(leaflet.hints, 1):
        y = _text(canvas, f"{k}. {hint}", _Box(box.x, y, box.width, 0), 10, lines=4) - 5
    x = box.x
    canvas.setFont(FONT, TEXT_SIZE)
    for sample, word in LEGEND:
        _shape(canvas, sample, x, y - 10 + SAMPLE / 2, SAMPLE)
        canvas.setFillGray(0.0)
        canvas.drawString(x + SAMPLE + 4, y - 12, word)
        x += SAMPLE + 22 + canvas.stringWidth(word, FONT, TEXT_SIZE)


def _step(canvas: Canvas, step: LeafletStep, box: _Box) -> None:
    canvas.setFillGray(0.0)
    canvas.setFont(FONT, 15)
    canvas.drawString(box.x, box.y - 15, str(step.number))
    indent = canvas.stringWidth(str(step.number), FONT, 15) + 7
    beside = _Box(box.x + indent, box.y - 2, box.width - indent, 0)
    lines = max(14, int(0.5 * box.height / (LINE_HEIGHT * TEXT_SIZE)))
    y = min(_text(canvas, step.text, beside, TEXT_SIZE, lines=lines), box.y - 18)
    _drawing(canvas, step.drawing, _Box(box.x, y - 6, box.width, box.height - (box.y - y) - 18))
    canvas.setStrokeGray(0.8)
    canvas.setLineWidth(0.4)
    canvas.line(box.x, box.y - box.height + 4, box.x + box.width, box.y - box.height + 4)


def _text(canvas: Canvas, text: str, box: _Box, size: float, *, lines: int) -> float:
    """Draw text in lines from the top of a box; return the y of its bottom."""
    canvas.setFillGray(0.0)
    canvas.setFont(FONT, size)
    split = simpleSplit(text, FONT, size, box.width)
    if len(split) > lines:
        split = [*split[: lines - 1], split[lines - 1].rstrip(" ;,.") + " …"]
    y = box.y
    for line in split:
        y -= LINE_HEIGHT * size
        canvas.drawString(box.x, y, line)
    return y


def _drawing(canvas: Canvas, drawing: Drawing, box: _Box, max_mm: float = MAX_SCALE_MM) -> None:
    """Draw a drawing in the middle of a box."""
    left, top, right, bottom = drawing.box
    wide, tall = right - left, bottom - top
    scale = min(box.width / wide, box.height / tall, max_mm * mm)
    x = box.x + (box.width - scale * wide) / 2 - scale * left
    y = box.y - (box.height - scale * tall) / 2 + scale * top
    for shape in drawing.shapes:
        if shape.text:
            _label(
                canvas, shape, box, x + scale * shape.points[0][0], y - scale * shape.points[0][1]
            )
        else:
            _shape(canvas, shape, x, y, scale)


def _label(canvas: Canvas, shape: Shape, box: _Box, x: float, y: float) -> None:
    """Draw the text of a label on white, within the sides of a box."""
    canvas.setFont(FONT, LABEL_SIZE)
    width = canvas.stringWidth(shape.text, FONT, LABEL_SIZE)
    left = min(max(x - (width if shape.ends else 0.0), box.x), box.x + box.width - width)
    canvas.setFillGray(1.0)
    canvas.rect(left - 0.5, y - 1, width + 1, LABEL_SIZE, stroke=0, fill=1)
    canvas.setFillGray(0.0)
    canvas.drawString(left, y, shape.text)


def _shape(canvas: Canvas, shape: Shape, x: float, y: float, scale: float) -> None:
    ink = INKS[shape.style]
    points = [(x + scale * px, y - scale * py) for px, py in shape.points]
    if ink.fill is not None:
        canvas.setFillGray(ink.fill)
    if ink.line is not None:
        canvas.setStrokeGray(ink.line)
        canvas.setLineWidth(line_width(ink, scale / mm) * mm)
        canvas.setLineJoin(1)
        canvas.setDash(*((ink.dash * scale, ink.dash * scale) if ink.dash else ()))
    strokes, fills = int(ink.line is not None), int(ink.fill is not None)
    if shape.radius:
        canvas.circle(*points[0], radius_of(shape, scale / mm) * mm, stroke=strokes, fill=fills)
        return
    path = canvas.beginPath()
    path.moveTo(*points[0])
    for point in points[1:]:
        path.lineTo(*point)
    if shape.closed:
        path.close()
    canvas.drawPath(path, stroke=strokes, fill=fills if shape.closed else 0)
    if ink.dash:
        canvas.setDash()
