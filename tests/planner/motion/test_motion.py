"""Windowed motions: they hold the values of dense ones, and neither kind copies needlessly."""

import dataclasses

import numpy as np
import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.motion.motion import PHASES, Motion
from tests.planner.chains import chain_of

CELLS = [(x if y % 2 == 0 else 3 - x, y, 0) for y in range(4) for x in range(4)]


@pytest.fixture
def chain() -> Chain:
    return chain_of(CELLS)


def frames_of(chain: Chain) -> Motion:
    """Return a folded frame, three that are partly straight, and a straight one."""
    rng = np.random.default_rng(1)
    count = len(chain.folded_rad)
    angles = np.zeros((5, count))
    angles[0] = chain.folded_rad
    for k, (a, b) in enumerate([(14, count), (9, 20), (0, 7)], start=1):
        angles[k, :a] = chain.folded_rad[:a]
        angles[k, a:b] = rng.uniform(-1.5, 1.5, b - a)
    angles = angles.astype(np.float32).astype(np.float64)
    turns = rng.normal(size=(5, 4))
    return Motion.from_frames(
        phase="explosion",
        time_s=np.arange(5.0),
        joint_angles_rad=angles,
        root_position=rng.normal(size=(5, 3)),
        root_wxyz=turns / np.linalg.norm(turns, axis=1)[:, None],
    )


def test_windows_become_the_same_frames_again(chain: Chain) -> None:
    frames = frames_of(chain)
    windows = frames.windowed(chain)
    dense_motion = windows.dense(chain)
    np.testing.assert_allclose(dense_motion.joint_angles_rad, frames.joint_angles_rad, atol=1e-7)
    before = chain.poses(frames.joint_angles_rad, frames.root_position, frames.root_wxyz)
    after = chain.poses(
        dense_motion.joint_angles_rad, dense_motion.root_position, dense_motion.root_wxyz
    )
    np.testing.assert_allclose(after.positions, before.positions, atol=1e-5)
    np.testing.assert_allclose(after.rotations, before.rotations, atol=1e-5)
    np.testing.assert_array_equal(dense_motion.time_s, frames.time_s)


def test_windows_hold_hinges_that_are_neither_folded_nor_straight(chain: Chain) -> None:
    windows = frames_of(chain).windowed(chain)
    count = len(chain.folded_rad)
    # Hinges that are 0 when folded count as either; windows begin after all that are folded.
    assert windows.first.tolist()[0] == count
    assert windows.first[1] >= 14 and windows.last[1] == count
    assert windows.last.tolist()[2:4] == [20, 7]
    straight = np.flatnonzero(chain.folded_rad)[0]
    assert (windows.first[4], windows.last[4]) == (straight, straight)


def test_slices_of_windows_are_joined(chain: Chain) -> None:
    windows = frames_of(chain).windowed(chain)
    parts = [windows[:2], windows[2:3], windows[np.array([3, 4])]]
    joined = Motion.joined(parts)
    for name, values in windows.columns().items():
        np.testing.assert_array_equal(joined.columns()[name], values)
    np.testing.assert_array_equal(windows.angles(chain, 2, 4), windows[2:4].angles(chain))
    assert Motion.from_columns(windows.columns()).is_windowed
    assert len(windows[::-1]) == 5
    np.testing.assert_array_equal(windows[::-1].angles(chain), windows.angles(chain)[::-1])


def test_joint_errors_are_those_of_the_windows(chain: Chain) -> None:
    windows = frames_of(chain).windowed(chain)
    rng = np.random.default_rng(2)
    errors = rng.uniform(1e-4, 1e-3, len(windows.angles_rad)).astype(np.float32)
    errors[: windows.offsets[2]] = np.nan  # window of the first two frames, one of which is empty
    off = dataclasses.replace(windows, errors_rad=errors)
    assert np.diff(off.offsets)[0] == 0
    assert off.recorded.tolist() == [False, False, True, True, bool(np.diff(off.offsets)[4])]
    dense = off.dense(chain).joint_error_rad
    assert np.isnan(dense[:2]).all()
    assert (dense[2, : off.first[2]] == 0.0).all()
    assert (dense[2, off.last[2] :] == 0.0).all()
    np.testing.assert_array_equal(
        dense[2, off.first[2] : off.last[2]], errors[off.offsets[2] : off.offsets[3]]
    )
    np.testing.assert_array_equal(off.largest_errors, dense.max(axis=1))
    np.testing.assert_array_equal(off.joint_errors(chain, 2, 4), dense[2:4])
    # Hinges that are folded or straight in a playback have no error.
    played = dataclasses.replace(off, phase=np.full(5, PHASES.index("playback"), np.uint8))
    assert played.largest_errors[0] == 0.0
    assert not windows.recorded.any()
    assert np.isnan(windows.largest_errors).all()
    assert np.isnan(windows.joint_errors(chain)).all()


def test_layouts_are_not_mixed(chain: Chain) -> None:
    dense = frames_of(chain)
    windows = dense.windowed(chain)
    with pytest.raises(TypeError, match="the same layout"):
        Motion.joined([dense, windows])
    with pytest.raises(TypeError, match="expected a dense motion"):
        _ = windows.root_position
    assert not dense.passes_as(windows)
    assert windows.in_layout_of(dense, chain).layout == "frames"
    assert windows.in_layout_of(windows, chain) is windows


def test_steps_are_the_same_in_either_layout(chain: Chain) -> None:
    dense = frames_of(chain)
    largest, moving = dense.steps(chain, fraction=0.1)
    of_windows = dense.windowed(chain).steps(chain, fraction=0.1)
    np.testing.assert_allclose(of_windows[0], largest, rtol=0.0, atol=1e-7)
    np.testing.assert_array_equal(of_windows[1], moving)
