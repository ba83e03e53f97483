import numpy as np
import pytest

from foldback.planner.certificate.motion_figures import MotionFigures
from foldback.planner.chain.chain import Chain
from foldback.planner.motion.motion import Motion, Phase
from tests.planner.chains import SQUARE

CHAIN = Chain.from_path(SQUARE)
HINGES = len(CHAIN.folded_rad)


def motion(angles_deg: list[list[float]], phase: Phase = "playback") -> Motion:
    """Return a motion whose first hinges have given angles; the others stay straight."""
    angles = np.zeros((len(angles_deg), HINGES))
    angles[:, : len(angles_deg[0])] = np.deg2rad(angles_deg)
    frames = len(angles)
    return Motion.from_frames(
        phase=phase,
        time_s=np.arange(float(frames)),
        joint_angles_rad=angles,
        root_position=np.zeros((frames, 3)),
        root_wxyz=np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1)),
    )


def test_travel_reversals_and_detours() -> None:
    # The first hinge overshoots by 20° and swings once more; the second one returns to straight.
    motion_figures = MotionFigures.of(
        CHAIN, motion([[0, 0], [60, 30], [110, -10], [80, 0.5], [90, 0.5], [90, 0]])
    )
    assert motion_figures is not None
    assert motion_figures.travel_ratio == pytest.approx((110 + 30 + 10 + 30 + 40 + 10.5 + 0.5) / 90)
    assert motion_figures.reversals_mean == pytest.approx((2 + 2) / HINGES)
    assert (motion_figures.detours, np.rad2deg(motion_figures.largest_detour_rad)) == (
        1,
        pytest.approx(30),
    )


def test_straight_motion_has_the_least_travel() -> None:
    motion_figures = MotionFigures.of(CHAIN, motion([[0, 0], [30, 0.9], [90, 0]]))
    assert motion_figures is not None
    assert motion_figures.travel_ratio == pytest.approx(1 + 1.8 / 90)
    assert (
        motion_figures.reversals_mean,
        motion_figures.detours,
        motion_figures.largest_detour_rad,
    ) == (0, 0, 0)


def test_refold_is_measured_by_way_of_straight() -> None:
    whole_motion = Motion.joined([motion([[90], [40]], "unfolding"), motion([[0], [90]])])
    motion_figures = MotionFigures.of(CHAIN, whole_motion)
    assert motion_figures is not None
    assert motion_figures.travel_ratio == pytest.approx(1)
    assert (motion_figures.detours, motion_figures.reversals_mean) == (0, 0)


def test_figures_are_none_without_motion() -> None:
    assert MotionFigures.of(CHAIN, motion([[0]])) is None
    still = MotionFigures.of(CHAIN, motion([[0], [0]]))
    assert still is not None
    assert still.travel_ratio is None
