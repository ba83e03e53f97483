from pathlib import Path

import numpy as np
import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.errors import TimelineError
from foldback.planner.motion.motion import PHASES, Motion
from foldback.planner.motion.timeline import Timeline, TimelineWriter
from foldback.web.timeline.frame_batch import (
    batch_of,
    cached_batch,
    chosen,
    thinned,
    unpacked_bytes,
)
from foldback.web.timeline.view import TimelineView
from tests.planner import peels
from tests.web import long_folds
from tests.web.conftest import Growing
from tests.web.timeline.decoding import decode, windows_of


def test_batch_holds_the_recorded_frames(timeline_path: Path) -> None:
    header, decoded_columns = decode(batch_of(TimelineView(timeline_path), 90, 130))
    frames = Timeline.open(timeline_path).frames(90, 130)
    assert (header["start"], header["stop"], header["total"]) == (90, 130, 200)
    assert header["status"] == "complete"
    assert np.array_equal(decoded_columns["time_s"], frames.time_s)
    assert np.array_equal(decoded_columns["phase"], frames.phase)
    assert np.allclose(decoded_columns["joint_angles_rad"], frames.joint_angles_rad, atol=6e-7)
    assert np.allclose(decoded_columns["root_position"], frames.root_position, atol=1e-6)
    assert np.allclose(decoded_columns["root_wxyz"], frames.root_wxyz, atol=1e-6)
    assert np.allclose(
        decoded_columns["joint_error_rad"], frames.joint_error_rad, rtol=1 / 256, equal_nan=True
    )
    assert [p["name"] for p in header["outline"]["phases"]] == ["explosion", "playback"]


def test_batch_has_a_stride_and_a_largest_size_and_ends_with_the_timeline(
    timeline_path: Path,
) -> None:
    view, times = TimelineView(timeline_path), Timeline.open(timeline_path).frames().time_s
    header, decoded_columns = decode(batch_of(view, stride=50))
    assert header["stride"] == 50
    assert np.array_equal(decoded_columns["time_s"], times[::50])
    header, decoded_columns = decode(batch_of(view, 10, largest=3000))
    assert 1 <= len(decoded_columns["time_s"]) < 20
    assert header["stop"] == 10 + len(decoded_columns["time_s"])
    _, first = decode(batch_of(view, 10, largest=1))
    assert len(first["time_s"]) == 1
    header, decoded_columns = decode(chosen(view, np.array([0, 3, 99, 150, 199])))
    assert (header["total"], header["stride"]) == (5, 1)
    assert np.array_equal(decoded_columns["time_s"], times[[0, 3, 99, 150, 199]])
    header, decoded_columns = decode(batch_of(view, 999))
    assert header["start"] == header["stop"] == 200
    assert decoded_columns["joint_angles_rad"].shape[0] == 0


def test_batch_has_no_frames_of_a_timeline_that_was_replaced(
    growing: Growing, chain: Chain, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, _, _ = growing
    timeline, read = TimelineView(path), Timeline.motion
    frames = Timeline.open(path).frames(0, 3)

    def replaced_meanwhile(self: Timeline, *arguments: int) -> Motion:
        read_frames = read(self, *arguments)
        with TimelineWriter.create(path, chain) as writer:
            writer.append(frames)
        return read_frames

    monkeypatch.setattr(Timeline, "motion", replaced_meanwhile)
    with pytest.raises(TimelineError, match="is being replaced"):
        cached_batch(timeline)
    monkeypatch.undo()
    timeline.refresh(at_once=True)
    assert decode(cached_batch(timeline))[0]["total"] == 3


def test_batch_of_a_finished_timeline_is_made_once(
    timeline_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    timeline = TimelineView(timeline_path)
    first = cached_batch(timeline, 3, 90, 7)
    assert first == batch_of(timeline, 3, 90, 7)
    # Another view of the same timeline does not read its frames again.
    second_timeline_view = TimelineView(timeline_path)
    monkeypatch.delattr(TimelineView, "motion")
    assert cached_batch(second_timeline_view, 3, 90, 7) == first


def test_batch_is_made_anew_when_its_timeline_grows(growing: Growing) -> None:
    path, writer, add = growing
    timeline = TimelineView(path)
    first, _ = decode(cached_batch(timeline))
    assert first["total"] == 10
    add(5)
    timeline.refresh(at_once=True)
    extra, _ = decode(cached_batch(timeline, 10))
    assert (extra["start"], extra["stop"], extra["status"]) == (10, 15, "growing")
    assert extra["id"] == first["id"]
    writer.close()
    timeline.refresh(at_once=True)
    assert decode(cached_batch(timeline))[0]["status"] == "complete"
    frames = Timeline.open(path).frames(0, 10)
    with TimelineWriter.reopen(path, frames=5) as writer:  # as many frames as before
        writer.append(frames)
    timeline.refresh(at_once=True)
    assert np.array_equal(
        decode(cached_batch(timeline))[1]["time_s"], Timeline.open(path).frames().time_s
    )
    with TimelineWriter.create(path, timeline.chain) as writer:
        writer.append(frames)
    timeline.refresh(at_once=True)
    assert decode(cached_batch(timeline))[0]["id"] != first["id"]


CHAIN = peels.snake((4, 4, 6))
LONG = long_folds.fold(CHAIN, width=20, step=1.3, base_moves=True)
OFF = long_folds.fold(CHAIN, width=20, step=1.3, base_moves=True, error_rad=1e-3)


@pytest.fixture(scope="module")
def films(tmp_path_factory: pytest.TempPathFactory) -> list[TimelineView]:
    """Views of timelines of a long fold: one not simulated, one simulated."""
    place = tmp_path_factory.mktemp("long")
    return [
        TimelineView(long_folds.write(place / str(k), CHAIN, motion))
        for k, motion in enumerate((LONG, OFF))
    ]


def test_long_fold_is_sent_as_windows(films: list[TimelineView]) -> None:
    header, decoded_columns = decode(batch_of(films[0], 30, 90, 4))
    assert (header["start"], header["stop"], header["total"]) == (30, 90, len(LONG))
    rows = windows_of(decoded_columns, CHAIN.folded_rad)
    expected = LONG[30:90:4]
    assert np.array_equal(rows.time_s, expected.time_s)
    assert np.array_equal(rows.first, expected.first)
    assert np.abs(rows.angles_rad - expected.angles_rad).max() < 6e-7
    assert [p["name"] for p in header["outline"]["phases"]] == ["explosion", "playback"]
    assert set(header["outline"]["errors"]) == {None}


def test_errors_of_a_simulated_long_fold_are_sent(films: list[TimelineView]) -> None:
    long_film, off_film = films
    header, decoded_columns = decode(batch_of(off_film))
    rows = windows_of(decoded_columns, CHAIN.folded_rad)
    assert np.array_equal(rows.recorded, OFF.phase == PHASES.index("playback"))
    assert np.allclose(rows.errors, OFF.errors, rtol=1 / 256, atol=0.0, equal_nan=True)
    errors = header["outline"]["errors"]
    assert set(errors[: len(errors) // 2]) == {None}
    assert max(errors[len(errors) // 2 :]) == pytest.approx(np.nanmax(OFF.errors), rel=1e-2)
    kinematic = unpacked_bytes(long_film)
    assert unpacked_bytes(off_film) == pytest.approx(kinematic + 4 * len(OFF.angles_rad), rel=0.1)


def test_long_batch_has_a_largest_size(films: list[TimelineView]) -> None:
    read_times_s: list[float] = []
    start = 0
    while start < len(LONG):
        header, decoded_columns = decode(batch_of(films[1], start, stride=3, largest=12000))
        assert header["start"] == start < header["stop"]
        fixed_bytes = 4 * len(decoded_columns["steps"]) + 4 * len(
            decoded_columns.get("errors_rad", ())
        )
        assert 80 * len(decoded_columns["time_s"]) + fixed_bytes <= 12000
        read_times_s += decoded_columns["time_s"].tolist()
        start = header["stop"] + -header["stop"] % 3
    assert read_times_s == LONG.time_s[::3].tolist()
    assert len(decode(batch_of(films[1], 10, largest=1))[1]["time_s"]) == 1


def test_long_fold_is_thinned(films: list[TimelineView]) -> None:
    header, decoded_columns = decode(thinned(films[1], 10))
    assert header["total"] == len(decoded_columns["time_s"]) == len(range(0, len(LONG), 10)) + 1
    assert decoded_columns["time_s"][-1] == LONG.time_s[-1]
    last = windows_of(decoded_columns, CHAIN.folded_rad)[-1:]
    assert np.allclose(last.errors, OFF[-1:].errors, rtol=1 / 256)
