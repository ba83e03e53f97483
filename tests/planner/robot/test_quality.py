from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from planner.robot.quality import Quality


@pytest.fixture(scope="module")
def plan(folded: Callable[..., Any]) -> Any:
    return folded("wrench-24").plan


def test_figures_are_those_of_the_certificate(plan: Any) -> None:
    told = plan.certificate
    quality = Quality.of(plan, told.fold_time_s)
    assert quality.frames == len(plan.time_s)
    assert quality.peak_speed_rad_s == pytest.approx(told.joint_speed_limit_rad_s)
    assert quality.peak_torque_nm == pytest.approx(told.peak_torque_nm)
    assert quality.clearance == told.min_clearance


def test_figures_scale_with_time(plan: Any) -> None:
    fast, slow = (Quality.of(plan, seconds) for seconds in (3.0, 6.0))
    assert fast.peak_speed_rad_s == pytest.approx(2.0 * slow.peak_speed_rad_s)
    assert fast.tail_speed == pytest.approx(2.0 * slow.tail_speed)
    assert fast.peak_torque_nm == pytest.approx(4.0 * slow.peak_torque_nm)
    assert (fast.length_rad, fast.tail_way) == (slow.length_rad, slow.tail_way)


def test_way_of_the_ends_is_that_of_kinematics(plan: Any) -> None:
    angles = plan.joint_angles_rad
    centres = plan.chain.poses(angles, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])).positions
    ends = centres[:, [0, -1]] - centres.mean(axis=1)[:, None]
    ways = [np.linalg.norm(np.diff(ends[:, k], axis=0), axis=1).sum() for k in (0, 1)]
    assert Quality.of(plan, 1.0).tail_way == pytest.approx(max(ways))
