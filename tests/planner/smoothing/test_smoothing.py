import numpy as np
import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.clearance.sweep import sweep
from foldback.planner.core import mark_blamed_hinges
from foldback.planner.errors import InputError
from foldback.planner.playback.reference_curve import record_lengths
from foldback.planner.smoothing.motion_quality import Quality
from foldback.planner.smoothing.smoothing import (
    DISTANCE_WEIGHT,
    FRAME_SPACING_RANGE_RAD,
    STAGES,
    smooth,
)
from foldback.planner.smoothing.smoothing_targets import direct
from tests.planner.chains import Array, coil, line, random_angles
from tests.planner.conftest import Folded

pytestmark = pytest.mark.slow


def length(chain: Chain, angles: Array) -> float:
    return float(record_lengths(chain, angles, DISTANCE_WEIGHT)[-1])


def travel(angles: Array) -> float:
    """Return the length of the path of all hinges, rad."""
    return float(np.abs(np.diff(angles, axis=0)).sum())


def test_smoothed_motion_is_shorter_and_as_clear_in_even_steps(folded: Folded) -> None:
    chain = folded.chain
    before = np.ascontiguousarray(folded.record.frames.joint_angles_rad[::-1])
    after = smooth(chain, before, module_size=0.95).angles
    steps = np.diff(record_lengths(chain, after, DISTANCE_WEIGHT))
    assert steps.max() <= 1.2 * FRAME_SPACING_RANGE_RAD[1]
    np.testing.assert_array_equal(after[[0, -1]], before[[0, -1]])
    for size in (0.95, 0.98):
        was, now = (sweep(chain, motion, module_size=size) for motion in (before, after))
        # At its frames it is as clear as before. Between frames, constant hinge rates cut corners,
        # which may reduce the clearance; at 0.95 every gap is wider by 0.03.
        assert now.per_frame.min() >= was.clearance - (0.003 if size < 0.98 else 2e-4)
        assert now.clearance >= 0.5 * was.clearance
        assert now.bound > 0.0
    assert length(chain, after) < 0.85 * length(chain, before)
    assert travel(after) < 0.9 * travel(before)
    assert len(after) < len(before)
    assert np.abs(after).max() <= max(np.abs(before).max(), chain.module.largest_angle_rad)


def test_groups_of_hinges_shorten_what_the_whole_chain_cannot(
    folded: Folded, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = np.ascontiguousarray(folded.record.frames.joint_angles_rad[::-1])
    least = float(np.abs(before[-1] - before[0]).sum())
    by_groups = travel(smooth(folded.chain, before, module_size=0.95).angles) - least
    whole = tuple(stage for stage in STAGES if stage.groups == 1)
    monkeypatch.setattr("foldback.planner.smoothing.smoothing.STAGES", whole)
    together = travel(smooth(folded.chain, before, module_size=0.95).angles) - least
    assert by_groups < 0.8 * together


def test_detour_is_removed() -> None:
    # Nothing obstructs a nearly straight chain: its hinges move at constant rates from end to end.
    chain = coil(12)
    rng = np.random.default_rng(0)
    ends = 0.1 * random_angles(chain, rng), 0.1 * random_angles(chain, rng)
    share = np.linspace(0.0, 1.0, 60)[:, None]
    detour = 0.3 * np.sin(np.pi * share) * random_angles(chain, rng)
    angles = (1.0 - share) * ends[0] + share * ends[1] + detour
    smoothing = smooth(chain, angles, module_size=0.95)
    shortest = np.abs(ends[1] - ends[0]).sum()
    assert travel(angles) > 1.5 * shortest
    assert travel(smoothing.angles) < 1.1 * shortest


def test_calm_motion_keeps_hinges_between_their_first_and_last_angle() -> None:
    motion = np.array([[0.0, 0.2, 0.1], [0.3, 0.5, 0.2], [-0.1, 0.1, 0.5], [0.0, 0.4, 0.3]])
    expected = [[0.0, 0.2, 0.1], [0.0, 0.4, 0.2], [0.0, 0.2, 0.3], [0.0, 0.4, 0.3]]
    np.testing.assert_array_equal(direct(motion), expected)
    # One hinge bends; another one leaves straight and returns.
    chain = line(8)
    angles = np.zeros((60, len(chain.folded_rad)))
    angles[:, 3] = np.linspace(0.0, 1.0, 60)
    angles[:, 8] = 0.3 * np.sin(np.linspace(0.0, np.pi, 60))
    angles[-1, 8] = 0.0
    # One evaluation allows no pass but the first.
    calm, usual = (
        smooth(chain, angles, module_size=0.95, looks=1, calm=c).angles for c in (True, False)
    )
    third = len(calm) // 3
    assert len(calm) > 40
    assert np.abs(calm[third:-third, 8]).max() < 1e-9
    assert np.abs(usual[:, 8]).max() > 0.25


def test_motions_of_few_frames_are_kept() -> None:
    chain = line(8)
    for frames in (1, 2, 3):
        smoothing = smooth(chain, np.zeros((frames, len(chain.folded_rad))), module_size=0.95)
        assert (smoothing.angles == 0.0).all()
    with pytest.raises(InputError, match="hinge angles"):
        smooth(chain, np.zeros((4, 27)), module_size=0.95)


def test_blame_falls_on_the_hinges_between() -> None:
    chain = coil(16)
    module = chain.module
    angles = np.zeros((2, len(chain.folded_rad)))
    angles[1, 8] = angles[1, 10] = angles[1, 12] = np.pi / 2  # the chain rotates into itself
    blamed = np.zeros(angles.shape, dtype=np.bool_)
    count = mark_blamed_hinges(angles, module.joint, module.hull, module.apart, 0.95, 0.01, blamed)
    assert count == 1
    assert not blamed[0].any()
    # Hinges 8, 10 and 12 belong to modules 5, 6 and 7: module 8 overlaps module 4.
    assert np.flatnonzero(blamed[1]).tolist() == list(range(6, 14))
    free = angles[1].copy()
    free[blamed[1]] = 0.0
    assert sweep(chain, free[None], module_size=0.95).clearance > 0.0


def test_figures_are_those_of_the_certificate_and_scale_with_time(folded: Folded) -> None:
    plan = folded.plan
    certificate = plan.certificate
    quality = Quality.of(plan, certificate.fold_time_s)
    assert quality.frames == len(plan.time_s)
    assert quality.peak_speed_rad_s == pytest.approx(certificate.joint_speed_limit_rad_s)
    assert quality.peak_torque_nm == pytest.approx(certificate.peak_torque_nm)
    assert quality.clearance == certificate.min_clearance
    slow = Quality.of(plan, 2.0 * certificate.fold_time_s)
    assert quality.peak_speed_rad_s == pytest.approx(2.0 * slow.peak_speed_rad_s)
    assert quality.tail_speed == pytest.approx(2.0 * slow.tail_speed)
    assert quality.peak_torque_nm == pytest.approx(4.0 * slow.peak_torque_nm)
    assert quality.length_rad == slow.length_rad
    upright = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    centres = plan.chain.poses(plan.joint_angles_rad, *upright).positions
    ends = centres[:, [0, -1]] - centres.mean(axis=1)[:, None]
    ways = np.linalg.norm(np.diff(ends, axis=0), axis=2).sum(axis=0)
    assert quality.tail_way == slow.tail_way == pytest.approx(ways.max())
