"""Drawings of steps for paper: the chain at rest, its moving part shaded, an arrow for the turn.

A drawing is a list of shapes in a plane, in pitches, x to the right and y down, that any writer of
vector graphics can draw in order. It is isometric: one view for a whole leaflet, unless the joint
of a step is hidden.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.corners import placed_faces
from foldback.planner.chain.kinematics import Poses
from foldback.planner.chain.module import Module
from foldback.planner.plan.steps import Step, Turn, hinge_axis

EYES: Final = (
    (1.0, -1.0, 1.0),
    (1.0, 1.0, 1.0),
    (-1.0, -1.0, 1.0),
    (-1.0, 1.0, 1.0),
    (1.0, -1.0, -1.0),
    (1.0, 1.0, -1.0),
)
"""Directions towards the eye, in the order of preference; the first one is that of the 3D view."""
KEPT_TAIL_MODULES: Final = 6
"""Number of modules that are drawn of a straight tail that is cut short."""
MIN_CUT_MODULES: Final = 4
"""Minimum number of modules that are left out where a straight tail is cut short."""
ARROW_RADIUS_PITCH: Final = (1.5, 2.2)
"""Minimum and maximum radius of an arrow, in pitches."""
MAX_SMALL_WIDTH_PITCH: Final = 14.0
"""Width or height of a drawing, in pitches, from which on arrows grow with it: it is scaled down to
fit on the paper."""
MAX_SCALE_MM: Final = 6.0
"""Maximum length of a pitch on paper in the drawing of a step, in mm."""
JOINT_PITCH: Final = 0.26
"""Radius of the dot at a joint that turns, in pitches."""
NUMBER_PLACES: Final = (
    *((0, row, side) for row in (0.9, 0.0, -0.9) for side in (1, -1)),
    *((1, row, side) for row in (0.0, 0.9, -0.9) for side in (1, -1)),
)
"""Places of a number relative to its dot, in the order of preference: columns away from it, heights
of a number above it, and 1 for the right or −1 for the left."""

Style = str
Point = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ink:
    """Paint of a style. Tones are 0 for black to 1 for white; None leaves it out.

    Attributes:
        fill: Tone of the area.
        line: Tone of the line.
        width: Width of the line, in pitches.
        dash: Length of dashes and gaps, in pitches; 0 for a continuous line.
    """

    fill: float | None = None
    line: float | None = None
    width: float = 0.0
    dash: float = 0.0


INKS: Final[dict[Style, Ink]] = {
    "held-0": Ink(fill=0.88, line=0.55, width=0.04),
    "held-1": Ink(fill=0.95, line=0.55, width=0.04),
    "held-2": Ink(fill=1.0, line=0.55, width=0.04),
    "moving-0": Ink(fill=0.4, line=0.0, width=0.07),
    "moving-1": Ink(fill=0.55, line=0.0, width=0.07),
    "moving-2": Ink(fill=0.72, line=0.0, width=0.07),
    "halo": Ink(line=1.0, width=0.42),
    "arrow": Ink(line=0.0, width=0.17),
    "head": Ink(fill=0.0, line=1.0, width=0.08),
    "axis": Ink(line=0.0, width=0.08, dash=0.25),
    "joint": Ink(fill=0.0, line=1.0, width=0.1),
    "first": Ink(fill=1.0, line=0.0, width=0.08),
    "last": Ink(fill=0.25, line=0.0, width=0.08),
    "cut": Ink(line=0.0, width=0.1),
    "label": Ink(fill=0.0),
}
"""Paint of each style: the held part light, the moving part dark with thick lines."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """One shape of a drawing.

    Attributes:
        style: Key of ``INKS``.
        points: Corners; the centre of a dot or the start of a label is the only one.
        closed: True for a polygon, false for a line.
        radius: Radius of a dot, in pitches; 0 for other shapes.
        text: Text of a label.
        ends: True if a label ends at its point instead of beginning there.
    """

    style: Style
    points: tuple[Point, ...]
    closed: bool = True
    radius: float = 0.0
    text: str = ""
    ends: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawing:
    """Shapes in the order in which they are drawn, and the eye that sees them so.

    Attributes:
        shapes: The shapes.
        eye: Index into ``EYES``.
    """

    shapes: tuple[Shape, ...]
    eye: int

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom of the drawing, in pitches."""
        points = np.array([point for shape in self.shapes for point in shape.points])
        (left, top), (right, bottom) = points.min(axis=0) - 0.5, points.max(axis=0) + 0.5
        return float(left), float(top), float(right), float(bottom)


def line_width(ink: Ink, scale_mm: float) -> float:
    """Return the width of a line on paper in mm, where a pitch is ``scale_mm`` long."""
    bold = {"arrow": 4.0, "halo": 9.0}
    min_width = next((k for style, k in bold.items() if ink is INKS[style]), 1.0) * 0.1
    return max(ink.width * scale_mm, min_width)


def radius_of(shape: Shape, scale_mm: float) -> float:
    """Return the radius of a dot on paper in mm, where a pitch is ``scale_mm`` long."""
    return max(shape.radius * scale_mm, 0.8)


def draw_shape(module: Module, poses: Poses, eye: int = 0) -> Drawing:
    """Draw a chain at rest, all of it light."""
    view = _View(eye)
    modules = np.arange(len(poses.positions))
    return Drawing(
        shapes=(*_faces(view, module, poses, modules, set()), *_ends(view, poses)), eye=eye
    )


def draw_step(
    module: Module,
    step: Step,
    poses: Poses,
    eye: int = 0,
    *,
    small_width: float = MAX_SMALL_WIDTH_PITCH,
) -> Drawing:
    """Draw a chain at the rest before a step.

    Args:
        module: Kind of the modules.
        step: The step.
        poses: Poses of all modules.
        eye: Index into ``EYES`` of the drawing before, which is kept if the joints are visible.
        small_width: Width or height, in pitches, from which on arrows grow with the drawing.
    """
    moving = {i for first, last in step.moving for i in range(first, last + 1)}
    eye = _clear_eye(step, poses, eye)
    view = _View(eye)
    first, last = _shown_modules(step, poses)
    visible_modules = np.arange(first, last + 1)
    shapes = [
        *_faces(view, module, poses, visible_modules, moving),
        *_ends(view, poses, first, last),
    ]
    width = float(np.ptp(view.flat(poses.positions[visible_modules]), axis=0).max())
    growth = max(1.0, width / small_width)
    if len(step.turns) <= 8:  # more would hide the chain
        for turn in step.turns:
            shapes += _arrow(view, module, turn, poses, growth=growth)
    pivots = {turn.module: hinge_axis(module, turn, poses)[1] for turn in step.turns}
    dots = dict(zip(pivots, view.points(np.array(list(pivots.values()))), strict=True))
    shapes += [Shape(style="joint", points=(dot,), radius=JOINT_PITCH) for dot in dots.values()]
    shapes += _numbers(dots, growth)
    return Drawing(shapes=tuple(shapes), eye=eye)


class _View:
    """Projection along the direction to an eye."""

    def __init__(self, eye: int) -> None:
        self.out = np.array(EYES[eye]) / np.sqrt(3.0)
        self.right = np.cross([0.0, 0.0, 1.0], self.out)
        self.right /= np.linalg.norm(self.right)
        self.up = np.cross(self.out, self.right)

    def flat(self, points: Array) -> Array:
        """Return the (..., 2) places of (..., 3) points on paper."""
        return np.stack([points @ self.right, -(points @ self.up)], axis=-1)

    def points(self, points: Array) -> tuple[Point, ...]:
        """Return the places of (N, 3) points on paper."""
        return tuple((x, y) for x, y in np.round(self.flat(points), 3).tolist())


def _faces(
    view: _View, module: Module, poses: Poses, visible_modules: Ints, moving: set[int]
) -> Iterable[Shape]:
    """Return the visible faces of some modules, from back to front."""
    faces = placed_faces(module, poses.positions, poses.rotations, visible_modules)
    # Light comes from above and from the right.
    brightness = faces.normals @ view.up + 0.4 * (faces.normals @ view.right)
    tones = np.digitize(brightness, (-0.4, 0.4))  # the three visible faces of a cube all differ
    # Cubes hide each other by their centres; faces of one module never hide each other.
    depth = (poses.positions[faces.modules] if module.fills_cell else faces.middles) @ view.out
    drawn = np.flatnonzero((faces.normals @ view.out > 1e-6) & faces.outer())
    for k in drawn[np.argsort(np.round(depth[drawn], 6), kind="stable")].tolist():
        part = "moving" if int(faces.modules[k]) in moving else "held"
        yield Shape(style=f"{part}-{tones[k]}", points=view.points(faces.corners[k]))


def _arrow(
    view: _View, module: Module, turn: Turn, poses: Poses, *, growth: float
) -> Iterable[Shape]:
    """Return the axis and the arrow of a joint that turns.

    Args:
        view: Projection of the drawing.
        module: Kind of the modules.
        turn: The turn.
        poses: Poses of all modules before it.
        growth: Size of both, 1 or more.
    """
    axis, pivot = hinge_axis(module, turn, poses)
    yield Shape(
        style="axis",
        points=view.points(pivot + np.outer((-1.1 * growth, 1.1 * growth), axis)),
        closed=False,
    )
    arc = _arc(turn, poses, axis, pivot, growth)
    line = view.points(arc[:-1])
    yield Shape(style="halo", points=line, closed=False)
    yield Shape(style="arrow", points=line, closed=False)
    yield Shape(style="head", points=_arrow_head(view.flat(arc), growth))


def _numbers(dots: Mapping[int, Point], growth: float) -> Iterable[Shape]:
    """Return the number of each joint beside its dot, where it covers no other number and no dot.

    Numbers that find no place are left out; the text of the step has all of them.

    Args:
        dots: Places of the dots on paper, by the module in front of the joint.
        growth: Length of a letter, relative to that in a small drawing.
    """
    height, radius = growth * 0.42, max(JOINT_PITCH, 0.5 * growth * JOINT_PITCH)
    occupied_boxes = [(x - radius, y - radius, x + radius, y + radius) for x, y in dots.values()]
    for module, (x, y) in dots.items():
        text = str(module + 1)
        width = 0.7 * height * len(text)
        for column, row, side in NUMBER_PLACES:
            near = x + side * (radius + 0.2 * height + column * 3.0 * height)
            base = y + 0.4 * height - row * height
            left, right = sorted((near, near + side * width))
            box = (left, base - height, right, base)
            if not any(_overlap(box, occupied) for occupied in occupied_boxes):
                occupied_boxes.append(box)
                place = (round(near, 3), round(base, 3))
                yield Shape(style="label", points=(place,), text=text, ends=side < 0)
                break


def _overlap(
    first: tuple[float, float, float, float], second: tuple[float, float, float, float]
) -> bool:
    """Return True if two boxes (left, top, right, bottom) overlap."""
    beside = first[2] <= second[0] or second[2] <= first[0]
    return not (beside or first[3] <= second[1] or second[3] <= first[1])


def _arc(turn: Turn, poses: Poses, axis: Array, pivot: Array, growth: float) -> Array:
    """Return points along the arrow of a turn, which begins at the part that moves."""
    low, high = turn.moves
    outwards = range(low, high + 1) if low > turn.module else range(high, low - 1, -1)
    offsets = poses.positions[list(outwards)] - pivot
    offsets = offsets - np.outer(offsets @ axis, axis)
    reach = np.linalg.norm(offsets, axis=1)
    far = np.flatnonzero(reach > 0.9)
    if len(far):
        start = offsets[far[0]] / reach[far[0]]
        radius = float(np.clip(reach.max(), ARROW_RADIUS_PITCH[0], ARROW_RADIUS_PITCH[1] * growth))
    else:  # all that moves is on the axis
        start = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        start, radius = start / np.linalg.norm(start), ARROW_RADIUS_PITCH[0]
    angles = np.linspace(0.08, 0.96, 16) * turn.angle_rad
    beside = np.cross(axis, start)
    return pivot + radius * (np.outer(np.cos(angles), start) + np.outer(np.sin(angles), beside))


def _arrow_head(flat: Array, growth: float) -> tuple[Point, ...]:
    """Return the triangle at the end of a line on paper."""
    tip, before = flat[-1], flat[-3]
    along = (tip - before) / max(float(np.linalg.norm(tip - before)), 1e-9) * growth
    normal = np.array([-along[1], along[0]])
    corners = (
        tip + 0.3 * along,
        tip - 0.45 * along + 0.38 * normal,
        tip - 0.45 * along - 0.38 * normal,
    )
    return tuple((float(x), float(y)) for x, y in np.round(corners, 3))


def _ends(view: _View, poses: Poses, first: int = 0, last: int | None = None) -> Iterable[Shape]:
    """Return the marks of both ends: white and dark dots, or where a tail is cut short."""
    end = len(poses.positions) - 1
    last = end if last is None else last
    for style, module, end_module, inwards in (("first", 0, first, 1), ("last", end, last, -1)):
        at = poses.positions[end_module]
        (dot,) = view.points(at[None])
        if module == end_module:
            yield Shape(style=style, points=(dot,), radius=0.3)
            continue
        outside = view.flat(at + 0.75 * (at - poses.positions[end_module + inwards]))
        normal = np.array([-(outside - dot)[1], (outside - dot)[0]])
        normal /= max(float(np.linalg.norm(normal)), 1e-9)
        zigzag = [
            outside + k * normal * 0.35 + 0.2 * (-1) ** k * np.array([normal[1], -normal[0]])
            for k in (-2, -1, 0, 1, 2)
        ]
        points = tuple((float(x), float(y)) for x, y in np.round(zigzag, 3))
        yield Shape(style="cut", points=points, closed=False)
        text = f"{abs(module - end_module)} more to {module + 1}"
        place = (float(outside[0]), float(outside[1]) - 0.7)
        yield Shape(style="label", points=(place,), text=text, ends=bool(outside[0] > dot[0]))


def _shown_modules(step: Step, poses: Poses) -> tuple[int, int]:
    """Return the first and the last module to draw: long straight tails are cut short."""
    count = len(poses.positions)
    along = np.diff(poses.positions, axis=0)
    bends = np.flatnonzero(np.abs(np.diff(along, axis=0)).max(axis=1) > 0.1) + 1
    joints = [turn.module for turn in step.turns]
    inner = [*bends.tolist(), *joints]
    first, last = min(inner) - KEPT_TAIL_MODULES, max(inner) + KEPT_TAIL_MODULES + 1
    first = first if first >= MIN_CUT_MODULES else 0
    last = last if count - 1 - last >= MIN_CUT_MODULES else count - 1
    return first, last


def _clear_eye(step: Step, poses: Poses, eye: int) -> int:
    """Return the eye from which the fewest joints are hidden; the given one if it is as good."""
    joints = sorted({turn.module for turn in step.turns})
    hidden = [_hidden(poses.positions, joints, np.array(way) / np.sqrt(3.0)) for way in EYES]
    return eye if hidden[eye] == min(hidden) else int(np.argmin(hidden))


def _hidden(positions: Array, modules: Sequence[int], out: Array) -> int:
    """Return how many of some modules others hide from an eye in a direction."""
    count = 0
    for module in modules:
        offsets = positions - positions[module]
        depth = offsets @ out
        beside = (offsets**2).sum(axis=1) - depth**2
        count += bool(((depth > 0.5) & (beside < 0.8**2)).any())  # as on the fold's page
    return count
