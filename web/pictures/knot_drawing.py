"""Knot drawings: the diagram of a knot as strokes, with gaps where one goes under another.

A projection of a tight knot is hard to read. The diagram is therefore laid out by the method of
Tutte (1963): one face becomes a circle, and each other vertex the mean of its neighbours, so that
strands cross only at the crossings of the diagram.
"""

from __future__ import annotations

from typing import Final, TypedDict

import numpy as np
from numpy.typing import NDArray

from foldback.planner.motion.failure_schemas import KnotFigures

Array = NDArray[np.float64]
DRAWING_SIDE: Final = 160
"""Width and height of the square drawing of a chain's knot diagram, in SVG user units."""
CROSSING_GAP: Final = 7.0
"""Length of the gap in the lower strand on each side of a crossing in a knot drawing, in SVG user
units."""
VERTICES_PER_ARC: Final = 2
"""Number of vertices that the computed layout of a knot drawing has on each arc between two
crossings."""
Face = list[int]


class KnotDrawing(TypedDict):
    """A drawing of a knot: its strokes as paths of SVG, in a square of ``side`` units."""

    side: int
    strokes: list[str]
    label: str


def drawing_of(figures: KnotFigures) -> KnotDrawing | None:
    """Return the drawing of a knot's diagram; None when it has too many crossings."""
    count = len(figures["diagram"])
    if not 0 < count <= 60:  # more are too dense to read
        return None
    # Passes are the crossings in their order along the strand, each of them twice.
    passes = sorted(
        (place, k, over)
        for k, crossing in enumerate(figures["diagram"])
        for place, over in ((crossing["over"], True), (crossing["under"], False))
    )
    crossing_at = [k for _, k, _ in passes]
    places = _laid_out(crossing_at, _faces(figures, passes), count)
    vertices: list[int] = []
    for arc in range(2 * count):
        vertices += [crossing_at[arc], *_bends(arc, count)]
    unders = [(VERTICES_PER_ARC + 1) * arc for arc, (_, _, over) in enumerate(passes) if not over]
    number = figures["determinant"]
    label = f"A knot with {count} crossings"
    return {
        "side": DRAWING_SIDE,
        "strokes": _strokes(places[vertices], unders),
        "label": label if number is None else f"{label}, determinant {number}",
    }


def _bends(arc: int, count: int) -> range:
    """Return the numbers of the vertices on an arc, which follow those of the crossings."""
    return range(count + VERTICES_PER_ARC * arc, count + VERTICES_PER_ARC * (arc + 1))


def _faces(figures: KnotFigures, passes: list[tuple[float, int, bool]]) -> list[Face]:
    """Return the faces of a diagram, each as the vertices around it.

    The sides of arc ``a`` are numbered ``2 a`` (along it) and ``2 a + 1`` (against it).
    """
    count, arcs = len(figures["diagram"]), len(passes)
    over, under = ([0] * count for _ in range(2))
    for arc, (_, k, above) in enumerate(passes):
        (over if above else under)[k] = arc
    following: dict[int, int] = {}
    for k, crossing in enumerate(figures["diagram"]):
        # Sides that leave the crossing, counterclockwise; those that come in are their opposites.
        ahead, behind = 2 * under[k], 2 * ((under[k] - 1) % arcs) + 1
        sideways = (ahead, behind) if crossing["sign"] > 0 else (behind, ahead)
        leaving = [2 * over[k], sideways[0], 2 * ((over[k] - 1) % arcs) + 1, sideways[1]]
        for side, before in zip(leaving, [leaving[-1], *leaving[:-1]], strict=True):
            following[side ^ 1] = before
    faces: list[Face] = []
    unvisited = set(following)
    while unvisited:
        side, face = min(unvisited), list[int]()
        while side in unvisited:
            unvisited.remove(side)
            arc = side // 2
            way = [passes[arc][1], *_bends(arc, count)]
            if side % 2:
                way = [passes[(arc + 1) % arcs][1], *reversed(_bends(arc, count))]
            face += way
            side = following[side]
        faces.append(face)
    return faces


def _laid_out(crossing_at: list[int], faces: list[Face], count: int) -> Array:
    """Return the (v, 2) positions of all vertices: the largest face around all others."""
    outer = max(faces, key=len)
    vertices = count + VERTICES_PER_ARC * len(crossing_at)
    total = vertices + len(faces)
    weights = np.zeros((total, total))
    for k, face in enumerate(faces):
        for start, two in zip(face, [*face[1:], face[0]], strict=True):
            weights[start, two] = weights[two, start] = 1.0
            if face is not outer:  # a vertex at its centre keeps it open
                weights[start, vertices + k] = weights[vertices + k, start] = 1.0
    turns = 2.0 * np.pi * np.arange(len(outer)) / len(outer)
    fixed = dict(zip(outer, np.stack([np.cos(turns), np.sin(turns)], axis=1), strict=False))
    system = np.diag(weights.sum(axis=1) + 1e-9) - weights
    targets = np.zeros((total, 2))
    for vertex, place in fixed.items():
        system[vertex] = 0.0
        system[vertex, vertex], targets[vertex] = 1.0, place
    places = np.linalg.solve(system, targets)[:vertices]
    # Faces are traversed with their inside on the left, so the outer one clockwise, the direction
    # of growing angles with y downwards. The opposite direction would draw the mirrored knot.
    return np.asarray(0.5 * DRAWING_SIDE + 66.0 * places, dtype=np.float64)


def _strokes(points: Array, unders: list[int]) -> list[str]:
    """Return SVG paths of a closed curve through (n, 2) points, with gaps at ``unders``."""
    closed = np.concatenate([points, points[:1]])
    from scipy.interpolate import CubicSpline  # imported late, because few folds fail at a knot

    curve = CubicSpline(np.arange(len(closed)), closed, bc_type="periodic")
    strokes: list[str] = []
    for start, end in zip(unders, [*unders[1:], unders[0] + len(points)], strict=True):
        way = np.asarray(curve(np.linspace(start, end, 8 * (end - start) + 1)))
        passed = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
        visible_points = way[(passed >= CROSSING_GAP) & (passed <= passed[-1] - CROSSING_GAP)]
        if len(visible_points) > 1:
            strokes.append("M" + " L".join(f"{x:.1f} {y:.1f}" for x, y in visible_points.tolist()))
    return strokes
