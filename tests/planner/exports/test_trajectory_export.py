import json
from typing import Any

import numpy as np
import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.clearance.sweep import sweep
from foldback.planner.exports.trajectory import Form, clearance, export, sufficient_rate, times
from foldback.planner.pipeline.fold import fold
from foldback.planner.trajectories.retiming import retime, retimed
from foldback.planner.trajectories.trajectory import Trajectory
from tests.planner.chains import coil
from tests.refusal import refused

NAMES = ("joint_1_z", "joint_1_y", "joint_2_z")


@pytest.fixture
def trajectory() -> Trajectory:
    steps = np.random.default_rng(3).uniform(-0.01, 0.03, (299, 3))
    steps[10] = 0.0
    return retimed(np.cumsum(np.vstack([np.zeros(3), steps]), axis=0), NAMES, 1.0, 2.0)


def text(trajectory: Trajectory, form: Form, clear: Any = None, **options: Any) -> str:
    parts = export(trajectory, form, name="three", plan_verified=True, clear=clear, **options)
    return b"".join(parts).decode()


def test_csv_and_json_hold_the_same_numbers(trajectory: Trajectory) -> None:
    heading, *lines = text(trajectory, "csv").splitlines()
    columns = ("time_s", *(f"{n}_rad" for n in NAMES), *(f"{n}_rad_s" for n in NAMES))
    assert tuple(heading.split(",")) == columns
    rows = np.loadtxt(lines, delimiter=",")
    assert len(rows) == 299  # of 300 frames, in two of which nothing moves
    assert (np.diff(rows[:, 0]) > 0.0).all()
    assert rows[:, 1:4] == pytest.approx(trajectory.at(rows[:, 0])[0], abs=1e-8)
    document = json.loads(text(trajectory, "json"))
    assert document["format"] == "foldback-trajectory/1"
    assert tuple(document["joint_names"]) == NAMES
    assert document["duration_s"] == trajectory.duration_s
    for name, values in (
        ("time_s", rows[:, 0]),
        ("joint_angles_rad", rows[:, 1:4]),
        ("joint_speeds_rad_s", rows[:, 4:]),
    ):
        assert np.array_equal(values, document[name])


def test_clearance_is_exported_only_if_checked(trajectory: Trajectory) -> None:
    unchecked, checked = (json.loads(text(trajectory, "json", c)) for c in (None, (0.05, 0.04)))
    assert "verified" not in unchecked
    assert (unchecked["plan_verified"], unchecked["min_clearance"]) == (True, None)
    assert unchecked["clearance_bound"] is None
    assert checked == {**unchecked, "min_clearance": 0.05, "clearance_bound": 0.04}
    unproved = json.loads(text(trajectory, "json", (0.05, 0.0)))
    assert unproved == {**checked, "clearance_bound": None}


@pytest.mark.parametrize("rows", [1, 2, 3, 100])
@pytest.mark.parametrize("rounded", [-1e-6, 0.0, 1e-6])
def test_last_rows_are_at_least_half_a_step_apart(
    trajectory: Trajectory, rows: int, rounded: float
) -> None:
    rate = rows / (trajectory.duration_s + rounded)
    stamps = times(trajectory, rate)
    assert stamps[-1] == trajectory.duration_s
    assert np.diff(stamps).min() >= 0.5 / rate
    assert len(stamps) == rows + 1


@pytest.mark.parametrize("rate", [0.7, 3.0, 50.0])
def test_deviation_bounds_the_lines_between_rows(trajectory: Trajectory, rate: float) -> None:
    stamps = times(trajectory, rate)
    moments = np.linspace(0.0, trajectory.duration_s, 5001)
    exact, rows = trajectory.at(moments)[0], trajectory.at(stamps)[0]
    lines = np.stack([np.interp(moments, stamps, column) for column in rows.T], axis=1)
    chord = np.abs(lines - exact).max()
    stated = json.loads(text(trajectory, "json", rate_hz=rate))["deviation_rad"]
    assert 0.0 < chord <= stated - trajectory.deviation_rad


def test_sufficient_rate_is_proved_clear() -> None:
    plan = fold(coil(16))
    size = plan.certificate.module_size
    fast = retime(plan, 50.0, 500.0)
    coarse = clearance(fast, plan.chain, module_size=size, rate_hz=1.0)
    assert coarse.bound <= 0.0
    rate = sufficient_rate(fast, plan.chain, module_size=size, rate_hz=1.0)
    assert rate is not None
    rows = np.round(fast.at(times(fast, rate))[0], 9)
    assert sweep(plan.chain, rows, module_size=size).bound > 0.0
    stopped = clearance(fast, plan.chain, module_size=size, rate_hz=rate, cancelled=lambda: True)
    assert stopped.bound <= 0.0


def test_rates_out_of_range_are_refused(trajectory: Trajectory, hook_chain: Chain) -> None:
    frames = np.linspace(0.0, 1.0, 5)[:, None] * np.ones(len(hook_chain.joint_names))
    slow = retimed(frames, hook_chain.joint_names, 1e-6, 1e6)
    count = (slow, 1e5)  # more rows than fit into memory
    for moved, rate in (count, *((trajectory, rate) for rate in (0.0, -1.0, np.nan, 1e9))):
        with refused("bad-rate"):
            times(moved, rate)
