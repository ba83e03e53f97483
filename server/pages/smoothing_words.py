"""Smoothing in words: what it has changed in a plan, as pages and the command line show it."""

from __future__ import annotations

from typing import Final, TypedDict

from planner.certificate.figures import SmoothingFigures
from planner.robot import RECORDED, SOFTENED
from server.pages.quantities import number, quantity


class Row(TypedDict):
    """One figure before and after, in words; the ratio where it says something."""

    label: str
    before: str
    after: str
    ratio: str


LABELS: Final[dict[str, tuple[str, str, int]]] = {
    "frames": ("Frames", "", 3),
    "fold_time_s": ("Time to fold", "s", 3),
    "length_rad": ("Path length", "rad", 3),
    "hinges_moving_mean": ("Mean hinges moving at once", "", 3),
    "hinges_moving_most": ("Most hinges moving at once", "", 3),
    "peak_speed_rad_s": ("Fastest hinge", "rad/s", 2),
    "peak_torque_nm": ("Largest torque", "N·m", 2),
    "tail_way": ("Way of an end", "pitch", 3),
    "tail_speed": ("Fastest end", "pitch/s", 2),
    "clearance": ("Clearance", "pitch", 2),
}
"""Label, unit and digits of each figure."""
NOTES: Final = {
    SOFTENED: "More of it was not as clear as the certificate asks.",
    RECORDED: "Nothing shorter was as clear as the certificate asks: only the times are new.",
}


def rows_of(smoothing: SmoothingFigures) -> list[Row]:
    """The rows of a plan's ``smoothing``; none when nothing came of it."""
    before, after = smoothing["before"], smoothing["after"] or {}
    return [
        {
            "label": label,
            "before": str(quantity(before[key], unit, digits)),
            "after": str(quantity(after[key], unit, digits)),
            "ratio": f"× {after[key] / before[key]:.2f}" if before[key] else "",
        }
        for key, (label, unit, digits) in LABELS.items()
        if key in after
    ]


def note_of(smoothing: SmoothingFigures) -> str:
    """In which time both are compared, and why not more came of it."""
    seconds = number(smoothing["seconds"], 3)
    told = f"Speeds and torque: both folding in {seconds} s."
    return f"{NOTES.get(smoothing['way'], '')} {told}".strip()
