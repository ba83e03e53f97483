from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.clearance.sweep import sweep
from planner.errors import InputError
from planner.kernels.smoothing import mark_blamed_hinges, write_displacements
from planner.playback.reference import record_lengths
from planner.robot.smoothing import DISTANCE_WEIGHT, FRAME_SPACING_RANGE_RAD, smooth
from planner.robot.smoothing_targets import along, mean, parts, softened, straight, worthwhile
from tests.planner.chains import coil, line, random_angles

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]
REAL = ("wrench-24", *(pytest.param(s, marks=pytest.mark.long) for s in ("mallet-64", "wrench-94")))


def recorded(folded: Callable[..., Any], shape: str) -> tuple[Chain, Array]:
    """A chain and its record from straight to folded."""
    fold = folded(shape)
    return fold.chain, np.ascontiguousarray(fold.record.frames.joint_angles_rad[::-1])


@pytest.fixture(scope="module")
def smoothed(folded: Callable[..., Any]) -> Callable[[str], Array]:
    """The smoothed record of a shape, made once."""

    @cache
    def made(shape: str) -> Array:
        return smooth(*recorded(folded, shape), size=0.95).angles

    return made


def length(chain: Chain, angles: Array) -> float:
    return float(record_lengths(chain, angles, DISTANCE_WEIGHT)[-1])


def travel(angles: Array) -> float:
    """How far all hinges turn together."""
    return float(np.abs(np.diff(angles, axis=0)).sum())


@pytest.mark.parametrize("shape", REAL)
def test_smoothed_motion_is_shorter_and_as_clear(
    shape: str, folded: Callable[..., Any], smoothed: Callable[[str], Array]
) -> None:
    chain, before = recorded(folded, shape)
    after = smoothed(shape)
    np.testing.assert_array_equal(after[[0, -1]], before[[0, -1]])
    for size in (0.95, 0.98):
        was, now = (sweep(chain, motion, size=size) for motion in (before, after))
        # It is as clear as before at its frames. Between them it may come nearer, by what the
        # hinges' even turns cut off; every gap is wider by 0.03 at 0.95.
        assert now.per_frame.min() >= was.clearance - (0.003 if size < 0.98 else 2e-4)
        assert now.clearance >= 0.5 * was.clearance
        assert now.bound > 0.0
    assert length(chain, after) < 0.85 * length(chain, before)
    assert travel(after) < 0.9 * travel(before)
    assert len(after) < len(before)
    assert np.abs(after).max() <= max(np.abs(before).max(), chain.module.angle_limit_rad)


def test_smoothed_steps_are_even(
    folded: Callable[..., Any], smoothed: Callable[[str], Array]
) -> None:
    chain = folded("wrench-24").chain
    steps = np.diff(record_lengths(chain, smoothed("wrench-24"), DISTANCE_WEIGHT))
    assert steps.max() <= 1.2 * FRAME_SPACING_RANGE_RAD[1]


def test_more_iterations_never_do_worse(folded: Callable[..., Any]) -> None:
    chain, angles = recorded(folded, "wrench-24")
    lengths = [
        length(chain, smooth(chain, angles, size=0.95, looks=n).angles) for n in (1, 3000, 12000)
    ]
    assert lengths[0] >= lengths[1] >= lengths[2]
    assert lengths[2] < 0.8 * lengths[0]


def test_cancelled_smoothing_returns_its_motion(folded: Callable[..., Any]) -> None:
    chain, angles = recorded(folded, "wrench-24")
    found = smooth(chain, angles, size=0.95, cancelled=lambda: True)
    np.testing.assert_array_equal(found.angles[[0, -1]], angles[[0, -1]])
    assert sweep(chain, found.angles, size=0.95).clearance > 0.0


def test_detour_is_removed() -> None:
    # Nothing is in the way of a nearly straight chain: its hinges run evenly from end to end.
    chain = coil(12)
    rng = np.random.default_rng(0)
    ends = 0.1 * random_angles(chain, rng), 0.1 * random_angles(chain, rng)
    share = np.linspace(0.0, 1.0, 60)[:, None]
    detour = 0.3 * np.sin(np.pi * share) * random_angles(chain, rng)
    angles = (1.0 - share) * ends[0] + share * ends[1] + detour
    found = smooth(chain, angles, size=0.95)
    shortest = np.abs(ends[1] - ends[0]).sum()
    assert travel(angles) > 1.5 * shortest
    assert travel(found.angles) < 1.1 * shortest


def test_overlapping_motion_gets_no_worse() -> None:
    chain = coil(16)
    angles = np.linspace(0.0, 1.0, 40)[:, None] * chain.folded_rad
    before = sweep(chain, angles, size=0.98)
    assert before.clearance < 0.0
    found = smooth(chain, angles, size=0.95)
    assert sweep(chain, found.angles, size=0.98).clearance >= before.clearance - 1e-6


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_motions_of_few_frames_are_kept(frames: int) -> None:
    chain = line(8)
    found = smooth(chain, np.zeros((frames, len(chain.folded_rad))), size=0.95)
    assert (found.angles == 0.0).all()


def test_motions_of_other_chains_are_refused() -> None:
    with pytest.raises(InputError, match="expected frames of 28 hinge angles"):
        smooth(coil(16), np.zeros((4, 27)), size=0.95)


def test_blame_falls_on_the_hinges_between() -> None:
    chain = coil(16)
    module = chain.module
    angles = np.zeros((2, len(chain.folded_rad)))
    angles[1, 8] = angles[1, 10] = angles[1, 12] = np.pi / 2  # a turn into itself
    blamed = np.zeros(angles.shape, dtype=np.bool_)
    count = mark_blamed_hinges(
        angles,
        module.joint,
        module.hull,
        module.apart,
        0.95,
        0.01,
        blamed,
    )
    assert count == 1
    assert not blamed[0].any()
    # Hinges 8, 10 and 12 are of modules 5, 6 and 7: module 8 lies in module 4.
    assert np.flatnonzero(blamed[1]).tolist() == list(range(6, 14))
    free = angles[1].copy()
    free[blamed[1]] = 0.0
    assert sweep(chain, free[None], size=0.95).clearance > 0.0


def test_displacements_agree_with_kinematics() -> None:
    chain = coil(12)
    module = chain.module
    rng = np.random.default_rng(1)
    angles = np.array([random_angles(chain, rng) for _ in range(4)])
    largest, mean_ = np.zeros(3), np.zeros(3)
    write_displacements(
        angles,
        module.joint,
        largest,
        mean_,
    )
    centres = chain.poses(angles, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])).positions
    centres -= centres.mean(axis=1, keepdims=True)
    moved = np.linalg.norm(np.diff(centres, axis=0), axis=2)
    np.testing.assert_allclose(largest, moved.max(axis=1))
    np.testing.assert_allclose(mean_, moved.mean(axis=1))


def test_targets_keep_the_ends_and_even_motions() -> None:
    rng = np.random.default_rng(2)
    even = np.linspace(0.0, 1.0, 50)[:, None] * rng.normal(size=7)
    rough = even + 0.1 * rng.normal(size=even.shape)
    begins = parts(50, 4, rng)
    assert begins[0] == 0
    assert begins[-1] == 49
    for target in (lambda a: straight(a, begins), lambda a: mean(a, 4)):
        np.testing.assert_allclose(target(even), even, atol=1e-12)
        np.testing.assert_array_equal(target(rough)[[0, -1]], rough[[0, -1]])
        assert np.abs(np.diff(target(rough), axis=0)).sum() < np.abs(np.diff(rough, axis=0)).sum()


def test_target_is_followed_where_it_costs_less() -> None:
    costs, new = np.ones(10), np.r_[np.full(5, 0.5), np.full(5, 2.0)]
    worth = worthwhile(costs, new, np.array([0, 5, 10]))
    np.testing.assert_array_equal(np.flatnonzero(worth), [1, 2, 3, 4])


def test_softened_shares_are_smaller() -> None:
    shares = np.ones((80, 2))
    shares[40, 1] = 0.0
    soft = softened(shares)
    assert (soft <= shares).all()
    assert (soft[[0, -1]] == 0.0).all()
    assert soft[40, 1] == 0.0
    assert soft[40, 0] == pytest.approx(1.0)
    assert np.abs(np.diff(soft, axis=0)).max() < 0.2


def test_interpolation_along_a_motion() -> None:
    angles = np.array([[0.0], [1.0], [1.0], [3.0]])
    lengths = np.array([0.0, 1.0, 1.0, 3.0])
    np.testing.assert_allclose(
        along(angles, lengths, np.array([0.0, 0.5, 1.0, 2.0, 3.0])).ravel(), [0, 0.5, 1, 2, 3]
    )
