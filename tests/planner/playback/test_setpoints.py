from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from planner.playback.reference import Reference
from planner.playback.setpoints import (
    REST_STEPS,
    SETTLE_STEPS,
    STALL_STEPS,
    Backwards,
    DirectSetpoints,
    Setpoints,
    SnapshotSetpoints,
    Target,
    TimedSetpoints,
)
from planner.playback.time_law import smooth_law

Array = NDArray[np.float64]
STEP_S = 0.02


def obeyed(setpoints: Setpoints, start: Array) -> list[Target]:
    """All targets for a chain that is always where it should be, and then at rest."""
    found: list[Target] = []
    angles, rates = start, np.zeros_like(start)
    while len(found) < 20_000:
        target = setpoints.target(angles, rates)
        if target is None:
            return found
        found.append(target)
        angles, rates = target.angles, target.rates
    raise AssertionError("the setpoints does not end")


def test_timed_setpoints_run_along_their_reference(folded: Callable[..., Any]) -> None:
    fold = folded("wrench-24")
    reference = Reference.through(
        fold.chain,
        fold.record.frames.joint_angles_rad[::-1],
        spacing_rad=0.03,
        distance_weight=0.03,
    )
    law = smooth_law(steps=600, step_s=STEP_S)
    targets = obeyed(TimedSetpoints(reference, law), np.zeros_like(fold.chain.folded_rad))
    assert len(targets) == 601 + SETTLE_STEPS
    angles = np.array([t.angles for t in targets])
    rates = np.array([t.rates for t in targets])
    accelerations = np.array([t.accelerations for t in targets])
    np.testing.assert_allclose(angles[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(angles[-1], fold.chain.folded_rad, atol=1e-12)
    np.testing.assert_array_equal(rates[-1], 0.0)
    # Semi-implicit Euler comes to the very next target.
    next_rates = rates[:-1] + STEP_S * accelerations[:-1]
    np.testing.assert_allclose(next_rates, rates[1:], atol=1e-9)
    np.testing.assert_allclose(angles[:-1] + STEP_S * next_rates, angles[1:], atol=1e-12)
    fractions = [t.fraction for t in targets]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0


def test_direct_setpoints_go_in_a_line_and_wait() -> None:
    folded_rad = np.array([np.pi / 2, 0.0, -np.pi / 2])
    targets = obeyed(DirectSetpoints(folded_rad, 400, STEP_S), np.zeros(3))
    angles = np.array([t.angles for t in targets])
    np.testing.assert_array_equal(angles[0], 0.0)
    np.testing.assert_array_equal(angles[-1], folded_rad)
    np.testing.assert_allclose(angles[:, 0], -angles[:, 2])
    assert len(targets) == 400 + REST_STEPS - 1


def test_direct_setpoints_wait_for_rest() -> None:
    setpoints = DirectSetpoints(np.ones(2), 10, STEP_S)
    for _ in range(5000):
        assert setpoints.target(np.zeros(2), np.ones(2)) is not None


def paper_guide(snapshots: Array, least_steps: int = 1) -> SnapshotSetpoints:
    return SnapshotSetpoints(snapshots, threshold_rad2=0.15, least_steps=least_steps)


def goals(setpoints: SnapshotSetpoints, angle: float, steps: int) -> list[float]:
    found = [setpoints.target(np.array([angle]), np.ones(1)) for _ in range(steps)]
    return [float(target.angles[0]) for target in found if target is not None]


STEPS_AWAY = np.array([[0.0], [0.3], [0.6], [0.9], [1.2]])


def test_snapshot_is_left_when_the_chain_is_near_after_the_least_steps() -> None:
    # Up to √0.15 = 0.387 from a chain that does not move: 0.6 is never reached.
    setpoints = paper_guide(STEPS_AWAY)
    assert goals(setpoints, 0.0, 5) == [0.0, 0.3, 0.6, 0.6, 0.6]
    assert goals(setpoints, 0.3, 3) == [0.9, 0.9, 0.9]
    assert goals(paper_guide(STEPS_AWAY, 3), 0.0, 8) == [0.0] * 3 + [0.3] * 3 + [0.6] * 2
    # The threshold alone skips what is near, but for the first, where the motion begins.
    setpoints = paper_guide(STEPS_AWAY, 0)
    assert goals(setpoints, 0.0, 3) == [0.0, 0.6, 0.6]
    assert goals(setpoints, 0.6, 1) == [1.2]


def test_snapshots_end_at_rest_at_the_last_one() -> None:
    snapshots = np.linspace(0.0, 1.0, 30)[:, None] * np.array([[1.0, -0.5]])
    targets = obeyed(paper_guide(snapshots), np.zeros(2))
    np.testing.assert_allclose(targets[-1].angles, snapshots[-1])


def test_chain_that_comes_no_nearer_stalls() -> None:
    setpoints = paper_guide(STEPS_AWAY, 2)
    given = sum(
        setpoints.target(np.zeros(1), np.ones(1)) is not None for _ in range(2 * STALL_STEPS)
    )
    assert given == 2 + 2 + 2 + STALL_STEPS


def test_backwards_has_a_snapshot_for_each_step() -> None:
    motion = Backwards(
        np.array([0.0, 0.2, 0.25, 0.25]), np.array([[0.0], [2.0], [3.0], [4.0]]), 0.1
    )
    assert [float(motion[k][0]) for k in range(len(motion))] == pytest.approx([4.0, 1.5, 0.5, 0.0])
