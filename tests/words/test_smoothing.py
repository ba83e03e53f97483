"""Smoothing in words: the question before it, and the gain after it."""

from typing import Any

from foldback.planner.certificate.figures import SmoothingFigures
from foldback.words.smoothing import (
    smoothing_gain,
    smoothing_label,
    smoothing_question,
    smoothing_rows,
)


def figures(
    travel: float | None, reversals: float, torque: float, clearance: float = 0.04
) -> dict[str, Any]:
    names = ("travel_ratio", "reversals_mean", "peak_torque_nm", "clearance")
    return dict(zip(names, (travel, reversals, torque, clearance), strict=True))


def smoothing(before: dict[str, Any], after: dict[str, Any] | None) -> SmoothingFigures:
    return {"way": "smoothed", "seconds": 10.0, "before": before, "after": after}


def test_gain_states_travel_reversals_and_torque() -> None:
    better = smoothing(figures(3.1, 1.0, 0.4), figures(1.8, 0.6, 0.3))
    assert smoothing_gain(better) == (
        "Travel 3.10 → 1.80 times the least; 40 % fewer turns back and forth; 25 % less torque in "
        "the same time."
    )
    assert smoothing_label(better) == "smoothed: 42 % less travel"
    worse = smoothing(figures(1.0, 0.0, 0.4), figures(1.0, 0.2, 0.5))
    assert smoothing_gain(worse) == (
        "Travel stays at 1.00 times the least; 0.2 turns back and forth of each hinge instead of "
        "none; 25 % more torque in the same time."
    )
    assert smoothing_label(worse) is None
    closer = smoothing(figures(1.5, 1.0, 0.4), figures(1.2, 1.0, 0.4, clearance=0.02))
    assert smoothing_gain(closer) == (
        "Travel 1.50 → 1.20 times the least; as many turns back and forth; as much torque in the "
        "same time; 50 % less clearance."
    )
    quieter = smoothing(figures(1.0, 0.0, 0.4), figures(1.0, 0.0, 0.1))
    assert smoothing_label(quieter) == "smoothed: 75 % less torque"


def test_nothing_is_claimed_without_figures() -> None:
    plain = {"frames": 10, "fold_time_s": 2.0}  # as earlier versions stated them
    for figureless in (
        smoothing(plain, plain),
        smoothing(figures(3.1, 1.0, 0.4), None),
        smoothing(figures(None, 0.0, 0.4), figures(None, 0.0, 0.4)),
    ):
        assert smoothing_gain(figureless) is None
    hardly_moving = smoothing(figures(None, 0.0, 0.4), figures(None, 0.0, 0.4))
    assert "Travel" not in " ".join(row["label"] for row in smoothing_rows(hardly_moving))


def test_question_states_time_and_what_remains() -> None:
    texts = {s: smoothing_question(s, by_turns=False) for s in (3.2, 8.0, 50.0, 200.0)}
    for seconds, time in ((3.2, "5 s"), (8.0, "10 s"), (50.0, "a minute"), (200.0, "3 minutes")):
        assert f"This takes about {time}. This fold stays" in texts[seconds]
    assert smoothing_question(3.2, by_turns=True).startswith("The hinges of this fold already")
