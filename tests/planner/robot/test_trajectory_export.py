from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from planner.errors import InputError
from planner.exports.trajectory import Form, export
from planner.robot.retiming import retimed
from planner.robot.trajectory import Trajectory

NAMES = ("joint_1_z", "joint_1_y", "joint_2_z")


@pytest.fixture
def trajectory() -> Trajectory:
    steps = np.random.default_rng(3).uniform(-0.01, 0.03, (299, 3))
    steps[10] = 0.0
    return retimed(np.cumsum(np.vstack([np.zeros(3), steps]), axis=0), NAMES, 1.0, 2.0)


def text(
    trajectory: Trajectory,
    form: Form,
    rate_hz: float | None = None,
    min_clearance: float | None = None,
) -> str:
    parts = export(
        trajectory,
        form,
        name="three",
        plan_verified=True,
        min_clearance=min_clearance,
        rate_hz=rate_hz,
    )
    return b"".join(parts).decode()


def table(csv: str) -> np.ndarray[Any, Any]:
    heading, *lines = csv.splitlines()
    assert heading.split(",") == [
        "time_s",
        *(f"{name}_rad" for name in NAMES),
        *(f"{name}_rad_s" for name in NAMES),
    ]
    return np.array([[float(cell) for cell in line.split(",")] for line in lines])


def test_both_forms_hold_the_same_numbers(trajectory: Trajectory) -> None:
    rows = table(text(trajectory, "csv"))
    document = json.loads(text(trajectory, "json"))
    assert document["format"] == "foldback-trajectory/1"
    assert tuple(document["joint_names"]) == NAMES
    assert document["duration_s"] == trajectory.duration_s
    assert np.array_equal(rows[:, 0], document["time_s"])
    assert np.array_equal(rows[:, 1:4], document["joint_angles_rad"])
    assert np.array_equal(rows[:, 4:], document["joint_speeds_rad_s"])


def test_only_what_was_looked_for_is_claimed(trajectory: Trajectory) -> None:
    unchecked, checked = (json.loads(text(trajectory, "json", None, c)) for c in (None, 0.05))
    assert "verified" not in unchecked
    assert (unchecked["plan_verified"], unchecked["min_clearance"]) == (True, None)
    assert checked == {**unchecked, "min_clearance": 0.05}


def test_every_line_has_a_later_time_and_the_angles_then(trajectory: Trajectory) -> None:
    rows = table(text(trajectory, "csv"))
    assert len(rows) == 299  # of 300 frames, in two of which nothing moves
    assert (np.diff(rows[:, 0]) > 0.0).all()
    assert rows[:, 1:4] == pytest.approx(trajectory.at(rows[:, 0])[0], abs=1e-8)
    assert rows[-1, 1:4] == pytest.approx(trajectory.joint_angles_rad[-1], abs=1e-8)


def test_a_rate_gives_even_times_and_the_end(trajectory: Trajectory) -> None:
    rows = table(text(trajectory, "csv", 50.0))
    assert np.diff(rows[:-1, 0]) == pytest.approx(0.02)
    assert 0.0 < rows[-1, 0] - rows[-2, 0] <= 0.02 + 1e-9
    assert rows[-1, 0] == pytest.approx(trajectory.duration_s)
    assert np.abs(rows[[0, -1], 4:]).max() < 1e-6


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, 1e9])
def test_a_rate_that_is_none_is_refused(trajectory: Trajectory, rate: float) -> None:
    with pytest.raises(InputError) as refused:
        export(trajectory, "csv", name="three", plan_verified=True, rate_hz=rate)
    assert refused.value.code == "bad-rate"
