"""Isometric drawings of cells as small SVG files: three tones, hidden faces left out."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foldback.web.pictures.meshes import DISPLAYED_MODULE_SIZE

Cell = tuple[int, int, int]
Point = tuple[float, float]

PITCH_UNITS: Final = 24.0
"""Length of one pitch (distance between neighbouring module centres) in an isometric drawing, in
user units of its SVG."""
EDGE_STROKE_PITCH: Final = 0.1
"""Width of the stroke around each face in an isometric drawing, in pitches."""
DRAWING_MARGIN_PITCH: Final = 0.6
"""Width of the empty margin around an isometric drawing, in pitches."""
QUARTER_TURN: Final[NDArray[np.int64]] = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
"""Rotation matrix by +90° about z, from the frame of shapes and of the 3D view to that of isometric
drawings (p_drawing = R p_shape), so that both show nearly the same sides of a shape."""
SINE, COSINE = 0.5, math.sqrt(0.75)

# Light comes from above and from the left. Pages may restyle the classes; a file on its own has
# these tones, which suit light and dark backgrounds.
FACE_COLOURS: Final = {
    "gap": "#646d79",
    "top": "#eceef1",
    "left": "#bcc3cc",
    "right": "#929ba7",
    "odd-top": "#e05a5f",
    "odd-left": "#c9232b",
    "odd-right": "#a0141b",
    "added-top": "#6c97f5",
    "added-left": "#3b70ec",
    "added-right": "#2350c4",
}
VISIBLE_SIDES: Final = ("left", "right", "top")


@dataclass(frozen=True, slots=True)
class Drawing:
    """Content of a drawing.

    Attributes:
        body: Elements of an SVG file.
        box: Left edge, top edge, width and height of the drawn part: the ``viewBox`` of the file.
    """

    body: str
    box: str

    def svg(self, *, size: int, title: str | None = None) -> str:
        """Return the SVG file; without a title it is hidden from screen readers."""
        name = (
            f'role="img" aria-label="{escape(title)}"><title>{escape(title)}</title>'
            if title
            else 'aria-hidden="true">'
        )
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" class="iso" width="{size}" height="{size}" '
            f'viewBox="{self.box}" stroke-linejoin="round" {name}{self.body}</svg>'
        )


def isometric_svg(
    cells: ArrayLike,
    *,
    size: int = 320,
    title: str | None = None,
    odd: ArrayLike = (),
    added: ArrayLike = (),
) -> str:
    """Draw cells as cubes, z upward, seen from (1, -1, 1) as in the 3D view.

    Args:
        cells: (n, 3) integers.
        size: Width and height in CSS pixels; the drawing scales.
        title: Text for screen readers; without one the drawing counts as decoration.
        odd: (m, 3) cells that prevent a path; they are red.
        added: (k, 3) further cells that a repair adds; they are blue.

    Returns:
        One ``<svg>`` element, with a class ``iso-…`` on each tone.
    """
    return isometric_drawing(cells, odd=odd, added=added).svg(size=size, title=title)


def isometric_drawing(cells: ArrayLike, *, odd: ArrayLike = (), added: ArrayLike = ()) -> Drawing:
    """Return the content of ``isometric_svg``."""
    order, added_order = _turned(cells), _turned(added)
    marks = dict.fromkeys(_turned(odd), "odd-") | dict.fromkeys(added_order, "added-")
    layers: dict[int, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    corners: list[Point] = []
    for cell, axis in _visible_faces([*order, *added_order]):
        paths = layers[sum(cell)]
        paths["gap"].append(_face_path(cell, axis, 1.0, corners))
        tone = marks.get(cell, "") + VISIBLE_SIDES[axis]
        paths[tone].append(_face_path(cell, axis, DISPLAYED_MODULE_SIZE - EDGE_STROKE_PITCH, []))
    # Cells of one layer, those with the same x + y + z, never hide one another.
    drawn = "".join(
        f'<path class="iso-{tone}" fill="{FACE_COLOURS[tone]}" {_stroke(tone)}'
        f'd="{"".join(layers[layer][tone])}"/>'
        for layer in sorted(layers)
        for tone in FACE_COLOURS
        if tone in layers[layer]
    )
    return Drawing(drawn, _view_box(corners))


def _turned(cells: ArrayLike) -> list[Cell]:
    """Return cells in the frame of drawings."""
    turned = np.asarray(cells, dtype=np.int64).reshape(-1, 3) @ QUARTER_TURN.T
    return [(x, y, z) for x, y, z in turned.tolist()]


def _stroke(tone: str) -> str:
    """Return the attributes of a stroke in the face's colour, which rounds its corners."""
    if tone == "gap":
        return ""
    return (
        f'stroke="{FACE_COLOURS[tone]}" stroke-width="{_short(EDGE_STROKE_PITCH * PITCH_UNITS)}" '
    )


def _visible_faces(cells: Iterable[Cell]) -> Iterator[tuple[Cell, int]]:
    filled = set(cells)
    if not filled:
        return
    farthest = max(max(cell) for cell in filled) + 1
    for cell in sorted(filled):
        for axis in range(3):
            if any(_seen(cell, axis, first, filled, farthest) for first in (1, 2)):
                yield cell, axis


def _seen(cell: Cell, axis: int, first: int, filled: set[Cell], farthest: int) -> bool:
    """Return True if half of a face is visible: no cell lies between its middle and the eye."""
    order = (axis, (axis + first) % 3, (axis + 3 - first) % 3)
    place = list(cell)
    while max(place) <= farthest:
        for step in order:
            place[step] += 1
            if (place[0], place[1], place[2]) in filled:
                return False
    return True


def _face_path(cell: Cell, axis: int, scale: float, corners: list[Point]) -> str:
    half = scale / 2
    a, b = (axis + 1) % 3, (axis + 2) % 3
    points: list[Point] = []
    for da, db in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        place = [float(c) for c in cell]
        # Faces of one module meet at its edges; the stroke hides rounding errors there.
        place[axis] += half
        place[a] += half * da
        place[b] += half * db
        points.append(_project(place))
    corners.extend(points)
    x, y = points[0]
    steps = "".join(
        f"l{_short(c - p)}{_joined(_short(d - q))}" for (p, q), (c, d) in pairwise(points)
    )
    return f"M{_short(x)}{_joined(_short(y))}{steps}z"


def _project(place: list[float]) -> Point:
    x, y, z = place
    return (y - x) * COSINE * PITCH_UNITS, ((x + y) * SINE - z) * PITCH_UNITS


def _short(value: float) -> str:
    text = f"{value:.1f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def _joined(number: str) -> str:
    return number if number.startswith("-") else f" {number}"


def _view_box(corners: list[Point]) -> str:
    if not corners:
        return "0 0 1 1"
    xs, ys = zip(*corners, strict=True)
    margin = DRAWING_MARGIN_PITCH * PITCH_UNITS
    x0, top = min(xs) - margin, min(ys) - margin
    width, height = max(xs) + margin - x0, max(ys) + margin - top
    return " ".join(_short(v) for v in (x0, top, width, height))
