from __future__ import annotations

import json
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.chain.chain import Chain
from planner.chain.module import CUBE
from planner.checked_zarr import check_chunks
from planner.errors import DamagedError, TimelineError
from planner.motion import timeline as timeline_module
from planner.motion.motion import PHASES, Motion, Phase
from planner.motion.timeline import Timeline, TimelineWriter, chain_attributes
from tests.case import case
from tests.planner.tampering import reseal

COLUMNS = ("time_s", "joint_angles_rad", "root_position", "root_wxyz")


def some_frames(
    count: int, *, start: int = 0, phase: Phase = "explosion", error: bool = False, joints: int = 6
) -> Motion:
    """Frames that all differ from each other."""
    rows = np.arange(start, start + count, dtype=np.float64)
    return Motion.from_frames(
        phase=phase,
        time_s=rows / 10,
        joint_angles_rad=rows[:, None] + np.arange(joints) / 16,
        root_position=rows[:, None] * [1.0, 2.0, 3.0],
        root_wxyz=np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
        joint_error_rad=np.tile(rows[:, None], (1, joints)) / 8 if error else None,
    )


def assert_same(found: Motion, expected: Motion) -> None:
    for column in (*COLUMNS, "phase", "joint_error_rad"):
        np.testing.assert_array_equal(getattr(found, column), getattr(expected, column))


@pytest.fixture
def place(tmp_path: FilePath) -> FilePath:
    return tmp_path / "timeline.zarr"


def test_timeline_is_read_with_its_phases_and_its_chain(place: FilePath, hook_chain: Chain) -> None:
    explosion = some_frames(3)
    playback = some_frames(4, start=3, phase="playback", error=True)
    with TimelineWriter.create(place, hook_chain) as writer:
        writer.append(explosion)
        writer.append(playback)
    timeline = Timeline.open(place)
    assert (len(timeline), timeline.status) == (7, "complete")
    assert_same(timeline.frames(), Motion.joined([explosion, playback]))
    assert [PHASES[p] for p in timeline.frames().phase] == ["explosion"] * 3 + ["playback"] * 4
    chain = timeline.chain
    assert (chain.name, chain.module, chain.pitch_m) == ("hook", hook_chain.module, 0.02)
    np.testing.assert_array_equal(chain.folded_rad, hook_chain.folded_rad)
    np.testing.assert_array_equal(chain.folded_poses.positions, hook_chain.folded_poses.positions)


@given(st.data())
def test_ranges_and_strides_are_those_of_the_whole(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    place = tmp_path_factory.getbasetemp() / "ranges.zarr"
    if not place.exists():
        chain = Chain.from_angles(CUBE, np.zeros(6))
        with TimelineWriter.create(place, chain) as writer:
            writer.append(some_frames(300))
    timeline = Timeline.open(place)
    start = data.draw(st.integers(0, 300))
    stop = data.draw(st.integers(start, 300))
    stride = data.draw(st.integers(1, 400))
    assert_same(timeline.frames(start, stop, stride), some_frames(300)[start:stop:stride])


def test_reader_follows_the_tail(place: FilePath, hook_chain: Chain) -> None:
    writer = TimelineWriter.create(place, hook_chain)
    timeline = Timeline.open(place)
    assert (len(timeline), timeline.status) == (0, "growing")
    assert not timeline.refresh()
    for start in range(0, 500, 50):
        writer.append(some_frames(50, start=start))
        writer.flush()
        assert timeline.refresh()
        assert len(timeline) == start + 50
        np.testing.assert_array_equal(
            timeline.frames(start).time_s, np.arange(start, start + 50) / 10
        )
    writer.close()
    assert timeline.refresh()
    assert timeline.status == "complete"


def test_reader_beside_a_busy_writer_sees_only_whole_frames(
    place: FilePath, hook_chain: Chain
) -> None:
    writer = TimelineWriter.create(place, hook_chain)

    def write() -> None:
        for start in range(0, 80, 4):
            writer.append(some_frames(4, start=start))
            writer.flush()
        writer.close()

    thread = threading.Thread(target=write)
    thread.start()
    timeline = Timeline.open(place)
    while timeline.status == "growing":
        timeline.refresh()
        assert len(timeline) % 4 == 0
        assert_same(timeline.frames(), some_frames(len(timeline)))
    thread.join()
    assert len(timeline) == 80


def test_frames_not_flushed_are_counted_by_the_writer_only(
    place: FilePath, hook_chain: Chain, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(timeline_module, "MIN_FLUSH_PERIOD_S", 1e9)
    writer = TimelineWriter.create(place, hook_chain)
    writer.append(some_frames(3))  # the first ones are shown at once
    writer.append(some_frames(5))
    assert len(writer) == 8
    assert len(Timeline.open(place)) == 3


def test_writer_with_slow_flushes_flushes_less_often(
    place: FilePath, hook_chain: Chain, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 0.0
    flushes: list[float] = []
    monkeypatch.setattr(timeline_module.time, "monotonic", lambda: now)
    writer = TimelineWriter.create(place, hook_chain)
    mark = writer._mark

    def slow_mark(status: timeline_module.Status) -> None:
        nonlocal now
        mark(status)
        flushes.append(now)
        now += 0.03 if now < 10.0 else 2.0

    monkeypatch.setattr(writer, "_mark", slow_mark)
    for k in range(400):
        now += 0.05
        writer.append(some_frames(1, start=k))
    cheap = np.diff([at for at in flushes if at < 10.0])
    dear = np.diff([at for at in flushes if at > 10.0])
    assert 0.15 < cheap[0] < 0.25  # whoever waits for the motion to begin waits no longer
    assert ((cheap[1:] > 0.32) & (cheap[1:] < 0.4)).all()  # a tenth of the time
    assert ((dear > 2.9) & (dear < 3.2)).all()  # and never more than a second after the last


def test_killed_writer_leaves_only_whole_frames(
    place: FilePath, hook_chain: Chain, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = TimelineWriter.create(place, hook_chain)
    writer.append(some_frames(5))
    writer.flush()
    # Killed when the columns have grown and the count has not been written yet.
    monkeypatch.setattr(writer, "_mark", _killed)
    writer.append(some_frames(7, start=5))
    with pytest.raises(KeyboardInterrupt):
        writer.flush()
    timeline = Timeline.open(place)
    assert (len(timeline), timeline.status) == (5, "growing")
    assert_same(timeline.frames(), some_frames(5))
    with pytest.raises(TimelineError, match="within the timeline's 5 frames"):
        timeline.frames(0, 6)

    with TimelineWriter.reopen(place) as again:
        again.append(some_frames(2, start=90))
    assert Timeline.open(place).frames().time_s.tolist() == [0.0, 0.1, 0.2, 0.3, 0.4, 9.0, 9.1]


def _killed(status: str) -> None:
    raise KeyboardInterrupt(status)


def test_reopened_writer_goes_on_after_the_frames_it_keeps(
    place: FilePath, hook_chain: Chain
) -> None:
    with TimelineWriter.create(place, hook_chain) as writer:
        writer.append(some_frames(200))
    with TimelineWriter.reopen(place, frames=130) as writer:
        assert len(writer) == 130
        assert Timeline.open(place).status == "growing"
        writer.append(some_frames(20, start=500))
    times = Timeline.open(place).frames().time_s
    np.testing.assert_array_equal(times, np.r_[np.arange(130), np.arange(500, 520)] / 10)
    check_chunks(place)
    for kept in (-1, 151):
        with pytest.raises(TimelineError, match="expected 0 to 150"):
            TimelineWriter.reopen(place, frames=kept)


def test_exception_marks_the_timeline_failed_and_keeps_its_frames(
    place: FilePath, hook_chain: Chain
) -> None:
    with pytest.raises(RuntimeError), TimelineWriter.create(place, hook_chain) as writer:
        writer.append(some_frames(4))
        raise RuntimeError("the simulation broke")
    timeline = Timeline.open(place)
    assert (len(timeline), timeline.status) == (4, "failed")


def test_append_takes_frames_of_the_chain_up_to_the_end(place: FilePath, hook_chain: Chain) -> None:
    writer = TimelineWriter.create(place, hook_chain)
    reader = Timeline.open(place)
    writer.append(some_frames(0))
    writer.flush()
    assert not reader.refresh()
    assert len(reader.frames()) == 0
    with pytest.raises(TimelineError, match="joint"):
        writer.append(some_frames(2, joints=8))
    writer.close()
    with pytest.raises(TimelineError, match="only to a growing one"):
        writer.append(some_frames(1))


def test_range_outside_is_refused(place: FilePath, hook_chain: Chain) -> None:
    with TimelineWriter.create(place, hook_chain) as writer:
        writer.append(some_frames(5))
    for wrong in ((-1, 2, 1), (0, 6, 1), (3, 2, 1), (0, 5, 0)):
        with case(wrong), pytest.raises(TimelineError, match="5 frames"):
            Timeline.open(place).frames(*wrong)


def test_missing_timeline_raises(place: FilePath) -> None:
    with pytest.raises(TimelineError, match="no timeline at"):
        Timeline.open(place)
    place.mkdir()
    with pytest.raises(TimelineError, match="no timeline at"):
        Timeline.open(place)


def edit_attributes(place: FilePath, **changes: object) -> None:
    """Changes the attributes on disk; None removes one."""
    file = place / "zarr.json"
    document = json.loads(file.read_text())
    document["attributes"].update(changes)
    document["attributes"] = {k: v for k, v in document["attributes"].items() if v is not None}
    file.write_text(json.dumps(document))
    reseal(place)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        *(({key: None}, None) for key in ("format", "frames", "chain", "status")),
        ({"format": "foldback-timeline/9"}, "foldback-timeline/9"),
        ({"frames": 9}, "promises 9 frames but has 5"),
        ({"frames": -1}, "promises -1 frames but has 5"),
        ({"chain": {}}, "is damaged"),
        ({"chain": {"module": "cubxe"}}, "is damaged"),
    ],
    ids=str,
)
def test_timeline_with_other_attributes_raises(
    place: FilePath, hook_chain: Chain, changes: dict[str, Any], told: str | None
) -> None:
    with TimelineWriter.create(place, hook_chain) as writer:
        writer.append(some_frames(5))
    if changes.get("chain"):
        changes = {"chain": {**chain_attributes(hook_chain), **changes["chain"]}}
    edit_attributes(place, **changes)
    with pytest.raises(TimelineError, match=told):
        Timeline.open(place)


def test_timeline_with_a_lost_column_or_half_of_its_attributes_raises(
    place: FilePath, hook_chain: Chain
) -> None:
    with TimelineWriter.create(place, hook_chain) as writer:
        writer.append(some_frames(5))
    file = place / "zarr.json"
    whole = file.read_text()
    file.write_text(whole[:50])
    with pytest.raises(TimelineError):
        Timeline.open(place)
    file.write_text(whole)
    shutil.rmtree(place / "root_position")
    with pytest.raises(TimelineError):
        Timeline.open(place)


def test_timeline_that_loses_frames_has_another_id(place: FilePath, hook_chain: Chain) -> None:
    with TimelineWriter.create(place, hook_chain) as writer:
        writer.append(some_frames(9))
    reader = Timeline.open(place)
    with TimelineWriter.reopen(place) as writer:
        writer.append(some_frames(3, start=9))
    assert Timeline.open(place).id == reader.id
    assert not reader.replaced
    with TimelineWriter.reopen(place, frames=2):
        pass
    assert Timeline.open(place).id != reader.id
    assert reader.replaced
    with pytest.raises(TimelineError, match="started again"):
        reader.refresh()
    assert_same(Timeline.open(place).frames(), some_frames(2))


def test_chunks_without_a_wanted_frame_are_not_read(place: FilePath, hook_chain: Chain) -> None:
    with TimelineWriter.create(place, hook_chain) as writer:
        writer.append(some_frames(400))
    for chunk in (place / "joint_angles_rad" / "c" / "1").iterdir():
        chunk.write_bytes(b"damaged")
    timeline = Timeline.open(place)
    assert_same(timeline.frames(0, 400, 300), some_frames(400)[0:400:300])
    with pytest.raises(DamagedError, match="joint_angles_rad/c/1/0 is damaged"):
        timeline.frames(0, 400, 100)


def damage_missing(file: FilePath) -> None:
    file.unlink()


def damage_bit(file: FilePath) -> None:
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 16
    file.write_bytes(data)


def damage_truncated(file: FilePath) -> None:
    file.write_bytes(file.read_bytes()[:-9])


def damage_empty(file: FilePath) -> None:
    file.write_bytes(b"")


def damage_foreign(file: FilePath) -> None:
    """Put another valid chunk of the same array in its place."""
    other = file.parents[1] / "1" / "0" if file.parents[1].name == "c" else file.parent / "1"
    file.write_bytes(other.read_bytes())


def damage_directory(file: FilePath) -> None:
    file.unlink()
    file.mkdir()


DAMAGES = (
    damage_missing,
    damage_bit,
    damage_truncated,
    damage_empty,
    damage_foreign,
    damage_directory,
)


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("array", ["joint_angles_rad/c/0/0", "phase/c/0", "time_s/c/0"])
def test_timeline_with_damaged_chunk_raises(
    place: FilePath, hook_chain: Chain, array: str, damage: Callable[[FilePath], None]
) -> None:
    """Also of an array that is all zeros, which zarr would fill in."""
    with TimelineWriter.create(place, hook_chain) as writer:
        writer.append(some_frames(130))
        writer.append(some_frames(130, start=130, phase="playback", error=True))
    damage(place / array)
    with pytest.raises(DamagedError, match=f"{array} is damaged"):
        Timeline.open(place).frames()
    with pytest.raises(DamagedError, match=f"{array} is damaged"):
        check_chunks(place)


@pytest.mark.parametrize("damage", [damage_truncated, damage_empty, damage_missing])
@pytest.mark.parametrize("name", ["phase/zarr.json", "joint_angles_rad/zarr.json"])
def test_timeline_with_damaged_array_metadata_raises(
    place: FilePath, hook_chain: Chain, name: str, damage: Callable[[FilePath], None]
) -> None:
    with TimelineWriter.create(place, hook_chain) as writer:
        writer.append(some_frames(5))
    damage(place / name)
    with pytest.raises(DamagedError):
        Timeline.open(place).frames()


@pytest.mark.parametrize("offset", range(60, 1400, 191))
def test_timeline_with_one_changed_byte_of_its_attributes_raises(
    place: FilePath, hook_chain: Chain, offset: int
) -> None:
    with TimelineWriter.create(place, hook_chain) as writer:
        writer.append(some_frames(5))
    file = place / "zarr.json"
    whole = file.read_bytes()
    k = offset % len(whole)
    if bytes([whole[k]]).isspace():  # means the same in JSON
        return
    file.write_bytes(whole[:k] + bytes([whole[k] ^ 1]) + whole[k + 1 :])
    with pytest.raises(TimelineError):
        Timeline.open(place).frames()


def test_writer_goes_on_only_with_an_undamaged_tail(place: FilePath, hook_chain: Chain) -> None:
    with TimelineWriter.create(place, hook_chain) as writer:
        writer.append(some_frames(5))
    (place / "joint_angles_rad" / "c" / "0" / "0").unlink()
    with pytest.raises(DamagedError):
        TimelineWriter.reopen(place)


AT_ONCE = """
import sys, threading, time
from planner.chain.chain import Chain
from planner.chain.path import Path
from planner.errors import TimelineError
from planner.motion.timeline import Timeline, TimelineWriter

chain = Chain.from_path(Path.from_cells([[0, 0, 0], [1, 0, 0], [1, 1, 0]], name="three"))
begin = threading.Barrier(2)

def look():
    begin.wait()
    try:
        Timeline.open(sys.argv[1])
    except TimelineError:
        pass

looking = threading.Thread(target=look)
looking.start()
begin.wait()
time.sleep(float(sys.argv[2]))
TimelineWriter.create(sys.argv[1], chain).close()
looking.join()
assert Timeline.open(sys.argv[1]).status == "complete"
"""


@pytest.mark.slow
def test_first_reader_does_not_disturb_the_first_writer(tmp_path: FilePath) -> None:
    for k in range(2):
        subprocess.run(
            [sys.executable, "-W", "error", "-c", AT_ONCE, str(tmp_path / f"{k}"), f"{k * 0.015}"],
            cwd=FilePath(__file__).parents[3],
            timeout=60,
            check=True,
        )
