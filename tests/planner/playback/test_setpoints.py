import numpy as np
import pytest

from foldback.planner.playback.setpoints import STALL_STEPS, Backwards, SnapshotSetpoints
from tests.planner.chains import Array


def paper_guide(snapshots: Array, steps_per_snapshot: int = 1) -> SnapshotSetpoints:
    return SnapshotSetpoints(snapshots, threshold_rad2=0.15, steps_per_snapshot=steps_per_snapshot)


def goals(setpoints: SnapshotSetpoints, angle: float, steps: int) -> list[float]:
    targets = [setpoints.target(np.array([angle]), np.ones(1)) for _ in range(steps)]
    return [float(target.angles[0]) for target in targets if target is not None]


STEPS_AWAY = np.array([[0.0], [0.3], [0.6], [0.9], [1.2]])


def test_snapshot_is_left_when_the_chain_is_near_after_the_least_steps() -> None:
    # At most √0.15 = 0.387 from a chain that does not move: 0.6 is never reached.
    setpoints = paper_guide(STEPS_AWAY)
    assert goals(setpoints, 0.0, 5) == [0.0, 0.3, 0.6, 0.6, 0.6]
    assert goals(setpoints, 0.3, 3) == [0.9, 0.9, 0.9]
    assert goals(paper_guide(STEPS_AWAY, 3), 0.0, 8) == [0.0] * 3 + [0.3] * 3 + [0.6] * 2
    # The threshold alone skips close snapshots, except the first, where the motion starts.
    setpoints = paper_guide(STEPS_AWAY, 0)
    assert goals(setpoints, 0.0, 3) == [0.0, 0.6, 0.6]
    assert goals(setpoints, 0.6, 1) == [1.2]


def test_chain_that_comes_no_nearer_stalls() -> None:
    setpoints = paper_guide(STEPS_AWAY, 2)
    given_sum = sum(
        setpoints.target(np.zeros(1), np.ones(1)) is not None for _ in range(2 * STALL_STEPS)
    )
    assert given_sum == 2 + 2 + 2 + STALL_STEPS


def test_backwards_has_a_snapshot_for_each_step() -> None:
    motion = Backwards(
        np.array([0.0, 0.2, 0.25, 0.25]), np.array([[0.0], [2.0], [3.0], [4.0]]), 0.1
    )
    assert [float(motion[k][0]) for k in range(len(motion))] == pytest.approx([4.0, 1.5, 0.5, 0.0])
