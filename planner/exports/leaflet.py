"""Leaflet: the content and the layout of printed steps, for the PDF and the HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from foldback.planner.errors import InputError
from foldback.planner.exports.export import export_name, require_frames
from foldback.planner.exports.step_drawing import (
    MAX_SMALL_WIDTH_PITCH,
    Drawing,
    Shape,
    draw_shape,
    draw_step,
)
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.step_text import step_text
from foldback.planner.plan.steps import Steps, steps_of

SQUARE: Final = ((0.1, 0.1), (0.9, 0.1), (0.9, 0.9), (0.1, 0.9))
MIDDLE: Final = ((0.5, 0.5),)
LEGEND: Final = (
    (Shape(style="held-1", points=SQUARE), "hold still"),
    (Shape(style="moving-1", points=SQUARE), "turn"),
    (Shape(style="joint", points=MIDDLE, radius=0.3), "joint that turns"),
    (Shape(style="first", points=MIDDLE, radius=0.3), "first module"),
    (Shape(style="last", points=MIDDLE, radius=0.3), "last module"),
)
"""Samples of the styles that a leaflet explains, within a square of 1 pitch, and their meanings."""
MAX_DRAWN_MODULES: Final = 250_000
"""Maximum number of modules in all drawings of a leaflet; drawing so many takes about 25 s."""
MAX_LARGE_STEPS: Final = 24
"""Maximum number of steps that are drawn large; more steps are drawn small, on fewer pages."""
PAGE_MM: Final = (182.0, 245.0)
"""Width and height of what fits on both A4 and Letter paper between their margins, in mm."""
HEAD_MM: Final = 17.0
"""Height of a step's text, in mm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeafletStep:
    """One step of a leaflet.

    Attributes:
        number: Its number, from 1.
        text: What to do, and whether the drawing shows another side than that of the step before.
        drawing: The chain before the step.
    """

    number: int
    text: str
    drawing: Drawing


@dataclass(frozen=True, slots=True, kw_only=True)
class Leaflet:
    """Content of a leaflet.

    Attributes:
        title: Name of the shape.
        summary: Numbers of modules, turns and steps.
        hints: Sentences that explain the drawings.
        shape: Drawing of the folded shape.
        steps: The steps.
        layout: Numbers of columns and of rows of steps on a page.
    """

    title: str
    summary: str
    hints: tuple[str, ...]
    shape: Drawing
    steps: tuple[LeafletStep, ...]
    layout: tuple[int, int]


def layout_of(drawings: Sequence[Drawing]) -> tuple[int, int]:
    """Return the numbers of columns and of rows of steps on a page; few and long ones are large."""
    count = len(drawings)
    if count > MAX_LARGE_STEPS:
        return 3, 4
    layouts = ((min(count, 2), min(-(-count // 2), 3)), (2, 1))
    return next((layout for layout in layouts if _scale_mm(drawings, layout) >= 1.5), (1, 1))


def _scale_mm(drawings: Sequence[Drawing], layout: tuple[int, int]) -> float:
    """Return the smallest length of a pitch in the drawings of a layout, in mm."""
    width, height = PAGE_MM[0] / layout[0], PAGE_MM[1] / layout[1] - HEAD_MM
    return min(
        min(width / (right - left), height / (bottom - top))
        for left, top, right, bottom in (drawing.box for drawing in drawings)
    )


def leaflet_of(plan: Plan) -> Leaflet:
    """Return the content of a plan's leaflet.

    Raises:
        InputError: ``no-frames``, ``too-many-steps``, or ``no-steps`` if the plan does not rest
            between steps.
    """
    require_frames(plan)
    steps = steps_of(plan)
    chain = steps.chain
    if (total := len(steps.steps) * len(chain)) > MAX_DRAWN_MODULES:
        raise InputError(
            "too-many-steps",
            f"got {len(steps.steps)} steps of {len(chain)} modules, which are {total} modules to "
            f"draw, expected at most {MAX_DRAWN_MODULES}; use the step document instead.",
        )
    drawn = _drawn(steps, MAX_SMALL_WIDTH_PITCH)
    layout = layout_of([step.drawing for step in drawn])
    if layout[1] == 1:
        drawn = _drawn(steps, 30.0)
    return Leaflet(
        title=export_name(chain.name),
        summary=f"{chain.module.words.counted(len(chain))}, {_count(steps.turn_count, 'turn')} in "
        f"{_count(len(steps.steps), 'step')}",
        hints=_hints(steps),
        shape=draw_shape(chain.module, chain.folded_poses),
        steps=drawn,
        layout=layout,
    )


def _count(number: int, word: str) -> str:
    return f"{number} {word}" if number == 1 else f"{number} {word}s"


def _hints(steps: Steps) -> tuple[str, ...]:
    chain = steps.chain
    hints = [
        f"Start with the straight chain of {chain.module.words.counted(len(chain))}. Count from "
        "the end with the white dot; the dark dot marks the last one.",
        "Each drawing shows the chain before its step. Hold the light part still, and turn the "
        "dark part at the black dot, as the arrow shows.",
        "The number at a black dot is that of the module. The dashed line is the axis of the turn.",
        "Where a straight end is cut off, the number says how many modules are left out.",
    ]
    if any(len(step.turns) > 1 for step in steps.steps):
        hints.append(
            "If a step has several black dots, turn there together and evenly: making these turns "
            "one after the other may not be possible. For two hands, fold the shape again with at "
            "most two hinges in one step."
        )
    return tuple(hints)


def _drawn(steps: Steps, small_width: float) -> tuple[LeafletStep, ...]:
    module, drawn, eye = steps.chain.module, list[LeafletStep](), 0
    for step, poses in zip(steps.steps, steps.poses()[:-1], strict=True):
        drawing = draw_step(module, step, poses, eye, small_width=small_width)
        text = step_text(module, step, max_listed=len(step.turns))
        if drawing.eye != eye:
            text += " Seen from another side."
        drawn.append(LeafletStep(number=step.number, text=text, drawing=drawing))
        eye = drawing.eye
    return tuple(drawn)
