"""Smoothing in words: what it has changed in a plan, as pages and the command line show it."""

from __future__ import annotations

from typing import Final, TypedDict

from planner.certificate.figures import SmoothingFigures
from planner.robot import RECORDED, SOFTENED
from server.pages.quantities import number


class Row(TypedDict):
    """One figure before and after, in words; the ratio where it says something."""

    label: str
    before: str
    after: str
    ratio: str


LABELS: Final[dict[str, tuple[str, float, int]]] = {
    "frames": ("Frames", 1.0, 3),
    "fold_time_s": ("Folding time, s", 1.0, 3),
    "length_rad": ("Path length, rad", 1.0, 3),
    "hinges_moving_mean": ("Hinges moving at once, mean", 1.0, 3),
    "hinges_moving_most": ("Hinges moving at once, most", 1.0, 3),
    "peak_speed_rad_s": ("Fastest hinge, rad/s", 1.0, 2),
    "peak_torque_nm": ("Largest torque, mN·m", 1e3, 2),
    "tail_way": ("Distance travelled by an end, pitches", 1.0, 3),
    "tail_speed": ("Fastest end, pitches/s", 1.0, 2),
    "clearance": ("Clearance, pitch", 1.0, 2),
}
"""What each figure is called with its unit, what it is multiplied by for that, and its digits."""
NOTES: Final = {
    SOFTENED: "More smoothing would have left too little clearance.",
    RECORDED: "Any shorter motion would have left too little clearance, so only the timing is new.",
}


def rows_of(smoothing: SmoothingFigures) -> list[Row]:
    """The rows of a plan's ``smoothing``; none when nothing came of it."""
    before, after = smoothing["before"], smoothing["after"] or {}
    return [
        {
            "label": label,
            "before": number(factor * before[key], digits),
            "after": number(factor * after[key], digits),
            "ratio": f"× {after[key] / before[key]:.2f}" if before[key] else "",
        }
        for key, (label, factor, digits) in LABELS.items()
        if key in after
    ]


def note_of(smoothing: SmoothingFigures) -> str:
    """In which time both are compared, and why not more came of it."""
    seconds = number(smoothing["seconds"], 3)
    told = f"Speeds and torques are compared at the same folding time, {seconds} s."
    return f"{NOTES.get(smoothing['way'], '')} {told}".strip()
