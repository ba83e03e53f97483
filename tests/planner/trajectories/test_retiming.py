from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foldback.planner.exports.trajectory import clearance
from foldback.planner.trajectories.retiming import retime, retimed
from foldback.planner.trajectories.trajectory import Trajectory
from tests.case import case
from tests.planner.chains import Array
from tests.refusal import refused

SPEED, ACCELERATION = 1.0, 2.0


def line(frames: Array, speed: float = SPEED, acceleration: float = ACCELERATION) -> Trajectory:
    names = tuple(f"joint_{k}" for k in range(frames.shape[1]))
    return retimed(frames, names, speed, acceleration)


def ramp(length: float, frames: int) -> Array:
    return np.linspace(0.0, length, frames)[:, None]


def test_retimed_fold_keeps_its_bounds_from_rest_to_rest(folded: Any) -> None:
    plan = folded.plan
    trajectory = retime(plan, SPEED, ACCELERATION)
    assert trajectory.time_s.shape == plan.time_s.shape
    assert trajectory.time_s[0] == 0.0
    assert trajectory.time_s[-1] == trajectory.duration_s
    assert (np.diff(trajectory.time_s) >= 0.0).all()
    ends = trajectory.at(np.array([0.0, trajectory.duration_s]))
    assert np.allclose(ends[0], plan.joint_angles_rad[[0, -1]], atol=1e-9)
    assert np.allclose(ends[1], 0.0, atol=1e-6)
    assert np.allclose(trajectory.at(trajectory.time_s)[0], trajectory.joint_angles_rad, atol=1e-9)
    # Speeds and accelerations are those of the angles.
    t = np.linspace(0.0, trajectory.duration_s, 8_001)
    angles, speeds, accelerations = trajectory.at(t)
    rates = np.diff(angles, axis=0) / t[1]
    assert np.allclose(rates, 0.5 * (speeds[1:] + speeds[:-1]), atol=2e-3)
    jumps = np.abs(np.diff(speeds, axis=0) / t[1] - accelerations[:-1]).max(axis=1)
    assert np.quantile(jumps, 0.9) < 0.05  # except for steps in which accelerations jump
    # Some bound is nearly always reached.
    used = np.maximum(
        np.abs(speeds).max(axis=1) / SPEED, np.abs(accelerations).max(axis=1) / ACCELERATION
    )
    assert np.quantile(used, 0.1) > 0.9


def test_retimed_fold_stays_near_the_plan_and_as_clear(folded: Any) -> None:
    frames = folded.plan.joint_angles_rad
    trajectory = retime(folded.plan, SPEED, ACCELERATION)
    t = np.linspace(0.0, trajectory.duration_s, 2001)
    place = trajectory.frame_at(t)
    left_frame = np.clip(place.astype(int), 0, len(frames) - 2)
    part = (place - left_frame)[:, None]
    straight = (1.0 - part) * frames[left_frame] + part * frames[left_frame + 1]
    off = np.abs(trajectory.at(t)[0] - straight).max()
    assert 0.0 < off <= trajectory.deviation_rad + 1e-9 < 0.005
    # A corner with legs of half a step is an eighth of the bend deep if all steps are the same.
    assert trajectory.deviation_rad <= np.abs(np.diff(frames, 2, axis=0)).max() / 8.0 + 2e-6
    certificate = folded.plan.certificate
    clearance_found = clearance(trajectory, folded.chain, module_size=certificate.module_size)
    assert clearance_found.clearance == pytest.approx(certificate.min_clearance, abs=0.005)
    assert 0.0 < clearance_found.bound <= clearance_found.clearance


@pytest.mark.parametrize("frames", [2, 3, 50])
def test_single_joint_takes_the_shortest_time(frames: int) -> None:
    for length, speed, acceleration, seconds in (
        (1.5, 1.0, 2.0, 1.5 + 0.5),  # a trapezoid of speed
        (1.5, 0.5, 2.0, 3.0 + 0.25),
        (0.2, 1.0, 2.0, 2.0 * np.sqrt(0.2 / 2.0)),  # a triangle
        *((1.0, 1e6, max_rate, 2.0 / np.sqrt(max_rate)) for max_rate in (1e-6, 1e6)),
    ):
        trajectory = line(ramp(length, frames), speed, acceleration)
        assert trajectory.duration_s == pytest.approx(seconds, rel=0.01)
        assert trajectory.duration_s >= seconds * (1.0 - 1e-9)


def test_frames_in_which_nothing_moves_take_no_time() -> None:
    frames = ramp(0.5, 20)
    halting = np.repeat(frames, [3 if k in (0, 7, 19) else 1 for k in range(20)], axis=0)
    trajectory = line(halting)
    assert trajectory.duration_s == pytest.approx(line(frames).duration_s)
    assert trajectory.time_s.shape == (26,)
    assert trajectory.joint_angles_rad[-1] == frames[-1]
    assert trajectory.frame_at(np.array([0.0, trajectory.duration_s])).tolist() == [0.0, 25.0]


@given(
    seed=st.integers(0, 2**32 - 1),
    frames=st.integers(2, 14),
    joints=st.integers(1, 4),
    roughness=st.floats(0.0, 1.0),
)
def test_bounds_hold_on_any_path(seed: int, frames: int, joints: int, roughness: float) -> None:
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(1, joints)) + roughness * rng.normal(size=(frames - 1, joints))
    path = np.concatenate([np.zeros((1, joints)), np.cumsum(0.02 * steps, axis=0)])
    trajectory = line(path)
    knots = trajectory.knot_times_s
    assert (np.diff(knots) > 0.0).all()
    inside = 1e-6 * np.diff(knots)
    t = np.concatenate([knots[:-1] + inside, knots[1:] - inside, 0.5 * (knots[1:] + knots[:-1])])
    _, speeds, accelerations = trajectory.at(t)
    assert np.abs(speeds).max() <= SPEED * (1.0 + 1e-6)
    assert np.abs(accelerations).max() <= ACCELERATION * (1.0 + 1e-4)


def test_bounds_out_of_range_and_plans_without_motion_are_refused() -> None:
    for bound in (0.0, -1.0, np.nan, np.inf):
        for bounds in ((bound, 1.0), (1.0, bound)):
            with case(bounds), refused("bad-bound"):
                line(ramp(1.0, 5), *bounds)
    for frames in (0, 1, 4):
        with case(frames), refused("no-motion"):
            line(np.zeros((frames, 2)))
