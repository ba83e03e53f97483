"""Smoothed plans in words: what smoothing will do, what it did, and its limit."""

from __future__ import annotations

from typing import Final, TypedDict

from foldback.planner.certificate.figures import SmoothingFigures
from foldback.planner.smoothing import RECORDED, SOFTENED
from foldback.words.certificate import label_of
from foldback.words.quantities import NO_BREAK_SPACE, number, quantity
from foldback.words.suggestions import about

SMOOTHING_FIGURES: Final[dict[str, tuple[str, str, int]]] = {
    "frames": (label_of("frames"), "", 3),
    "fold_time_s": (label_of("fold_time_s"), "s", 3),
    "length_rad": ("Path length of the motion", "rad", 3),
    "travel_ratio": (f"{label_of('travel_ratio')}, times the least possible", "", 3),
    "reversals_mean": (label_of("reversals_mean"), "", 2),
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
SMOOTHING_AIMS: Final = {
    False: "foldback looks for a motion with shorter paths, fewer turns back and forth and less "
    "torque, and proves it free of collisions.",
    True: "The hinges of this fold already turn straight to their goals, a few at a time. "
    "Smoothing lets them start and stop more softly, which needs less torque but more time.",
}
"""What smoothing does to a fold, by whether its motion consists of turns."""
ROUNDED_SECONDS: Final = (5, 10, 20, 30, 45)
"""Seconds to which expected times of smoothing are rounded up."""
SMOOTHING_NOTES: Final = {
    SOFTENED: "The motion was smoothed only a little: more smoothing would have left too little "
    "clearance.",
    RECORDED: "Only the timing of the motion is new: the shorter paths that were tried leave too "
    "little clearance.",
}


MIN_COMPARED_REVERSALS: Final = 0.05
"""Mean number of reversals of a hinge below which a motion counts as one without reversals."""

MIN_KEPT_CLEARANCE: Final = 0.95
"""Ratio of the clearance after smoothing to that before, below which the loss is stated."""


class BeforeAfter(TypedDict):
    """One figure before and after smoothing, in words; the ratio of two numbers."""

    label: str
    before: str
    after: str
    ratio: str


def smoothing_rows(smoothing: SmoothingFigures) -> list[BeforeAfter]:
    """Return figures of a plan before and after smoothing; none when smoothing changed nothing."""
    rows: list[BeforeAfter] = []
    for key, (label, unit, digits) in SMOOTHING_FIGURES.items():
        before, after = _figures(smoothing, key)
        if before is None or after is None:
            continue
        rows.append(
            {
                "label": label,
                "before": str(quantity(before, unit, digits)),
                "after": str(quantity(after, unit, digits)),
                "ratio": f"×{NO_BREAK_SPACE}{after / before:.2f}" if before else "",
            }
        )
    return rows


def smoothing_question(seconds: float, *, by_turns: bool) -> str:
    """Return what smoothing a fold will do, for people who are about to start it.

    Args:
        seconds: Expected duration, s.
        by_turns: True if the fold's motion consists of turns.
    """
    rounded = next((step for step in ROUNDED_SECONDS if seconds <= step), None)
    time = about(seconds) if rounded is None else f"about {rounded} s"
    return (
        f"{SMOOTHING_AIMS[by_turns]} This takes {time}. This fold stays as it is; the smoothed one "
        "becomes a fold of its own, and you can compare both."
    )


def smoothing_gain(smoothing: SmoothingFigures) -> str | None:
    """Return by how much smoothing changed travel, reversals and torque, as one sentence.

    It also states a loss of clearance. None if nothing was smoothed, or if an earlier version did
    it.
    """
    travel, new_travel = _figures(smoothing, "travel_ratio")
    reversals, new_reversals = _figures(smoothing, "reversals_mean")
    torque, new_torque = _figures(smoothing, "peak_torque_nm")
    clearance, new_clearance = _figures(smoothing, "clearance")
    if travel is None or new_travel is None or reversals is None or new_reversals is None:
        return None
    if f"{travel:.2f}" == f"{new_travel:.2f}":
        parts = [f"Travel stays at {travel:.2f} times the least"]
    else:
        parts = [f"Travel {travel:.2f} → {new_travel:.2f} times the least"]
    if reversals >= MIN_COMPARED_REVERSALS:
        change = _change(reversals, new_reversals, ("fewer", "more"), same="as many")
        parts.append(f"{change} turns back and forth")
    elif new_reversals >= MIN_COMPARED_REVERSALS:
        count = number(new_reversals, 2)
        parts.append(f"{count} turns back and forth of each hinge instead of none")
    if torque and new_torque:
        parts.append(f"{_change(torque, new_torque)} torque in the same time")
    if clearance and new_clearance and new_clearance < MIN_KEPT_CLEARANCE * clearance:
        parts.append(f"{_change(clearance, new_clearance)} clearance")
    return "; ".join(parts) + "."


def smoothing_label(smoothing: SmoothingFigures) -> str | None:
    """Return the largest gain of smoothing in a few words; None if there is none."""
    for key, noun in (("travel_ratio", "travel"), ("peak_torque_nm", "torque")):
        before, after = _figures(smoothing, key)
        if before and after and after < 0.99 * before:
            return f"smoothed: {_change(before, after)} {noun}"
    return None


def _figures(smoothing: SmoothingFigures, key: str) -> tuple[float | None, float | None]:
    """Return a figure before and after smoothing; None where it is unknown."""
    return smoothing["before"].get(key), (smoothing["after"] or {}).get(key)


def _change(
    before: float,
    after: float,
    comparatives: tuple[str, str] = ("less", "more"),
    *,
    same: str = "as much",
) -> str:
    """Return a relative change in words: ``40 % less``, ``as much``."""
    percent = round(100.0 * (after / before - 1.0))
    return f"{abs(percent)} % {comparatives[percent > 0]}" if percent else same


def smoothing_note(smoothing: SmoothingFigures) -> str:
    """Return the folding time at which both plans are compared, and the limit of smoothing."""
    seconds = number(smoothing["seconds"], 3)
    text = f"Speeds and torques are compared at the same folding time, {seconds} s."
    return f"{SMOOTHING_NOTES.get(smoothing['way'], '')} {text}".strip()
