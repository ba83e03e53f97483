"""Smoothed plans in words: figures before and after, and the limit of smoothing."""

from __future__ import annotations

from typing import Final, TypedDict

from foldback.planner.certificate.figures import SmoothingFigures
from foldback.planner.smoothing import RECORDED, SOFTENED
from foldback.words.certificate import label_of
from foldback.words.quantities import number, quantity

SMOOTHING_FIGURES: Final[dict[str, tuple[str, str, int]]] = {
    "frames": (label_of("frames"), "", 3),
    "fold_time_s": (label_of("fold_time_s"), "s", 3),
    "length_rad": ("Path length of the motion", "rad", 3),
    "hinges_moving_mean": (label_of("hinges_moving_mean"), "", 3),
    "hinges_moving_most": (label_of("hinges_moving_most"), "", 3),
    "peak_speed_rad_s": ("Highest hinge speed", "rad/s", 2),
    "peak_torque_nm": ("Largest torque", "N·m", 2),
    "tail_way": ("Distance travelled by a chain end", "pitch", 3),
    "tail_speed": ("Highest speed of a chain end", "pitch/s", 2),
    "clearance": ("Clearance", "pitch", 2),
}
"""Label, unit and number of significant digits of each figure of a plan that is compared before and
after its smoothing."""
SMOOTHING_NOTES: Final = {
    SOFTENED: "The motion was smoothed only a little: more smoothing would have left too little "
    "clearance.",
    RECORDED: "Only the timing of the motion is new: the shorter paths that were tried leave too "
    "little clearance.",
}


class BeforeAfter(TypedDict):
    """One figure before and after smoothing, in words; the ratio of two numbers."""

    label: str
    before: str
    after: str
    ratio: str


def smoothing_rows(smoothing: SmoothingFigures) -> list[BeforeAfter]:
    """Return figures of a plan before and after smoothing; none when smoothing changed nothing."""
    before, after = smoothing["before"], smoothing["after"] or {}
    return [
        {
            "label": label,
            "before": str(quantity(before[key], unit, digits)),
            "after": str(quantity(after[key], unit, digits)),
            "ratio": f"× {after[key] / before[key]:.2f}" if before[key] else "",
        }
        for key, (label, unit, digits) in SMOOTHING_FIGURES.items()
        if key in after
    ]


def smoothing_note(smoothing: SmoothingFigures) -> str:
    """Return the folding time at which both plans are compared, and the limit of smoothing."""
    seconds = number(smoothing["seconds"], 3)
    text = f"Speeds and torques are compared at the same folding time, {seconds} s."
    return f"{SMOOTHING_NOTES.get(smoothing['way'], '')} {text}".strip()
