from pathlib import Path

import numpy as np
import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.errors import TimelineError
from foldback.planner.motion.timeline import Timeline, TimelineWriter
from foldback.web.timeline.view import TimelineView
from tests.planner import peels
from tests.web import long_folds
from tests.web.conftest import FINAL_ERROR_RAD, Growing, unfolding


def test_first_frame_is_folded_and_middle_is_straight(timeline_path: Path, chain: Chain) -> None:
    timeline = TimelineView(timeline_path)
    assert len(timeline) == 200
    assert np.allclose(timeline.snapshot(0).positions, chain.folded_poses.positions, atol=1e-5)
    straight = timeline.snapshot(99).positions
    steps = np.diff(straight, axis=0)
    assert np.allclose(steps, steps[0], atol=1e-5)
    assert timeline.snapshot(99).phase == "explosion"
    assert timeline.snapshot(100).phase == "playback"


def test_snapshot_is_interpolated_and_clipped_to_the_ends(timeline_path: Path) -> None:
    timeline = TimelineView(timeline_path)
    low, between, high = (timeline.snapshot(f) for f in (20, 20.25, 21))
    assert np.allclose(
        between.joint_angles_rad, 0.75 * low.joint_angles_rad + 0.25 * high.joint_angles_rad
    )
    lengths = np.linalg.norm(np.diff(between.positions, axis=0), axis=1)
    assert np.allclose(lengths, 1.0, atol=1e-5)  # no link is broken
    assert timeline.snapshot(-5).frame == 0
    assert timeline.snapshot(1e9).frame == 199


def test_module_errors_are_those_of_the_timeline(timeline_path: Path) -> None:
    timeline = TimelineView(timeline_path)
    assert np.isnan(timeline.snapshot(50).module_error_rad).all()
    module_error_rad = timeline.snapshot(199).module_error_rad
    assert int(np.argmax(module_error_rad)) == 6
    assert module_error_rad[6] == pytest.approx(FINAL_ERROR_RAD, rel=1e-5)
    assert timeline.error_scale_rad == FINAL_ERROR_RAD


def test_outline_has_phases_and_the_largest_error(timeline_path: Path) -> None:
    outline = TimelineView(timeline_path).outline(columns=20)
    assert outline["phases"] == [
        {"name": "explosion", "from": 0, "to": 100},
        {"name": "playback", "from": 100, "to": 200},
    ]
    assert outline["errors"][:10] == [None] * 10
    assert outline["errors"][-1] == pytest.approx(FINAL_ERROR_RAD, rel=1e-2)
    assert outline["errors"][10:] == sorted(outline["errors"][10:])


def test_frames_are_the_same_with_a_cache_of_one_byte(
    timeline_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    timeline_view = TimelineView(timeline_path)
    monkeypatch.setattr("foldback.web.timeline.view.MAX_CHUNK_CACHE_BYTES", 1)
    timeline = TimelineView(timeline_path)
    for frame in range(199, -1, -9):
        assert np.array_equal(
            timeline.snapshot(frame).positions, timeline_view.snapshot(frame).positions
        )


def test_growing_timeline_is_followed(growing: Growing) -> None:
    path, writer, add = growing
    timeline = TimelineView(path)
    assert (len(timeline), timeline.growing) == (10, True)
    assert not timeline.refresh(at_once=True)
    add(60)
    assert timeline.refresh(at_once=True)
    assert len(timeline) == 70
    assert timeline.snapshot(69).frame == 69
    writer.close()
    assert timeline.refresh(at_once=True)
    assert timeline.status == "complete"


def test_restarted_timeline_is_shown_from_its_start(growing: Growing, chain: Chain) -> None:
    path, writer, add = growing
    add(90)
    timeline = TimelineView(path)
    writer.close()
    for frames in (190, 5):
        before = timeline.snapshot(4)
        with TimelineWriter.create(path, chain) as second_writer:
            second_writer.append(unfolding(chain, frames))  # the same times, other angles
        assert timeline.refresh(at_once=True)
        assert len(timeline) == frames
        assert np.abs(timeline.snapshot(4).positions - before.positions).max() > 0.1


def test_missing_or_empty_timeline_is_an_error(tmp_path: Path, chain: Chain) -> None:
    with pytest.raises(TimelineError):
        TimelineView(tmp_path / "none")
    TimelineWriter.create(tmp_path / "empty", chain)
    with pytest.raises(TimelineError, match="no frame"):
        TimelineView(tmp_path / "empty").snapshot(0)


LONG_CHAIN = peels.snake((4, 4, 12))
LONG = long_folds.fold(LONG_CHAIN, width=20, step=1.3, base_moves=True)


@pytest.fixture(scope="module")
def long_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return long_folds.write(tmp_path_factory.mktemp("long") / "timeline", LONG_CHAIN, LONG)


def test_long_fold_is_posed_as_its_windows(long_path: Path) -> None:
    timeline = TimelineView(long_path)
    assert timeline.windowed
    dense = LONG.dense(LONG_CHAIN)
    poses = LONG_CHAIN.poses(dense.joint_angles_rad, dense.root_position, dense.root_wxyz)
    for frame in (0, 77, len(LONG) - 1):
        snapshot = timeline.snapshot(frame)
        assert np.allclose(snapshot.positions, poses.positions[frame], atol=2e-5)
        assert np.allclose(snapshot.joint_angles_rad, dense.joint_angles_rad[frame])
        assert np.isnan(snapshot.module_error_rad).all()
    between = 0.75 * dense.joint_angles_rad[77] + 0.25 * dense.joint_angles_rad[78]
    assert np.allclose(timeline.snapshot(77.25).joint_angles_rad, between)


def test_peeled_chain_shows_the_errors_of_its_robot(peeled: Path) -> None:
    view = TimelineView(peeled / "timeline")
    assert view.windowed
    dense = Timeline.open(view.path).frames()
    playback_start = view.outline()["phases"][1]["from"]
    assert np.isnan(view.snapshot(playback_start - 1).module_error_rad).all()
    assert np.isnan(view.snapshot(playback_start - 0.5).module_error_rad).all()
    largest = np.nanmax(dense.joint_error_rad, axis=1, initial=0.0)
    for frame in (playback_start, int(largest.argmax()), len(view) - 1):
        snapshot = view.snapshot(frame)
        assert np.array_equal(snapshot.joint_error_rad, dense.joint_error_rad[frame])
        assert snapshot.module_error_rad.max() == largest[frame]
    assert view.error_scale_rad >= largest.max()
    errors = [error for error in view.outline()["errors"] if error is not None]
    assert max(errors) == pytest.approx(largest.max(), rel=1e-2)


def test_timeline_without_errors_is_shown(tmp_path: Path) -> None:
    motion = LONG.with_angles(LONG.angles_rad)
    view = TimelineView(long_folds.write(tmp_path / "timeline", LONG_CHAIN, motion))
    assert np.isnan(view.snapshot(len(view) - 1).joint_error_rad).all()
    assert set(view.outline()["errors"]) == {None}


def test_camera_frames_the_moving_part_of_a_long_fold(long_path: Path) -> None:
    timeline = TimelineView(long_path)
    assert timeline.snapshot(0).framed == len(LONG_CHAIN)  # all modules are folded
    assert timeline.snapshot(len(LONG) // 2).framed < len(LONG_CHAIN)
    moving = int(np.flatnonzero(LONG.last < len(LONG_CHAIN.folded_rad))[0])
    bent = -(-int(LONG.last[moving]) // 2) + 1
    assert timeline.snapshot(moving).framed == min(len(LONG_CHAIN), bent + timeline.stretch)


def test_opening_a_long_fold_reads_no_angles(
    long_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Timeline, "windows", None)
    monkeypatch.setattr(Timeline, "frames", None)
    assert len(TimelineView(long_path)) == len(LONG)
