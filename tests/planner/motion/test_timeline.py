import io
import json
import os
import tracemalloc
import zlib
from pathlib import Path as FilePath
from unittest.mock import Mock
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.chain_attributes import chain_attributes
from foldback.planner.chain.path import Path
from foldback.planner.errors import DamagedError, TimelineError
from foldback.planner.motion import timeline as timeline_module
from foldback.planner.motion.motion import PHASES, Motion, Phase
from foldback.planner.motion.timeline import Timeline, TimelineWriter
from foldback.planner.storage.array_files import check_folder, read_head, save_npz, write_head
from tests.case import case

LINE = Path.from_cells([(k, 0, 0) for k in range(3)])
COLUMNS = ("time_s", "joint_angles_rad", "root_position", "root_wxyz")


def some_frames(
    count: int, *, start: int = 0, phase: Phase = "explosion", error: bool = False, joints: int = 6
) -> Motion:
    """Return frames that all differ from each other."""
    rows = np.arange(start, start + count, dtype=np.float64)
    return Motion.from_frames(
        phase=phase,
        time_s=rows / 10,
        joint_angles_rad=rows[:, None] + np.arange(joints) / 16,
        root_position=rows[:, None] * [1.0, 2.0, 3.0],
        root_wxyz=np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
        joint_error_rad=np.tile(rows[:, None], (1, joints)) / 8 if error else None,
    )


def assert_same(motion: Motion, expected: Motion) -> None:
    for column in (*COLUMNS, "phase", "joint_error_rad"):
        np.testing.assert_array_equal(getattr(motion, column), getattr(expected, column))


@pytest.fixture
def place(tmp_path: FilePath) -> FilePath:
    return tmp_path / "timeline"


@pytest.fixture
def five(place: FilePath, hook_chain: Chain) -> FilePath:
    """Timeline of five frames."""
    return write_timeline(place, hook_chain, some_frames(5))


def write_timeline(place: FilePath, chain: Chain, *parts: Motion) -> FilePath:
    with TimelineWriter.create(place, chain) as writer:
        for part in parts:
            writer.append(part)
    return place


def test_timeline_is_written_without_links(
    place: FilePath, hook_chain: Chain, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The sandbox of the service refuses links."""
    monkeypatch.setattr(os, "link", Mock(side_effect=PermissionError))
    frames = some_frames(5)
    assert_same(Timeline.open(write_timeline(place, hook_chain, frames)).frames(), frames)


def test_timeline_is_read_with_its_phases_and_its_chain(place: FilePath, hook_chain: Chain) -> None:
    explosion = some_frames(3)
    playback = some_frames(4, start=3, phase="playback", error=True)
    timeline = Timeline.open(write_timeline(place, hook_chain, explosion, playback))
    assert (len(timeline), timeline.status) == (7, "complete")
    assert_same(timeline.frames(), Motion.joined([explosion, playback]))
    assert [PHASES[p] for p in timeline.frames().phase] == ["explosion"] * 3 + ["playback"] * 4
    chain = timeline.chain
    assert (chain.name, chain.module, chain.pitch_m) == ("hook", hook_chain.module, 0.02)
    np.testing.assert_array_equal(chain.folded_rad, hook_chain.folded_rad)
    np.testing.assert_array_equal(chain.folded_poses.positions, hook_chain.folded_poses.positions)


def test_ranges_and_strides_are_those_of_the_whole(place: FilePath, hook_chain: Chain) -> None:
    timeline = Timeline.open(write_timeline(place, hook_chain, some_frames(300)))
    for expected in ((0, 300, 1), (17, 290, 3), (130, 140, 1), (255, 300, 7), (9, 9, 400)):
        with case(expected):
            assert_same(timeline.frames(*expected), some_frames(300)[slice(*expected)])


def test_reader_follows_the_tail(place: FilePath, hook_chain: Chain) -> None:
    writer = TimelineWriter.create(place, hook_chain)
    timeline = Timeline.open(place)
    assert (len(timeline), timeline.status) == (0, "growing")
    assert not timeline.refresh()
    for start in range(0, 300, 100):
        writer.append(some_frames(100, start=start))
        writer.flush()
        assert timeline.refresh()
        assert_same(timeline.frames(start), some_frames(100, start=start))
    writer.close()
    assert timeline.refresh()
    assert timeline.status == "complete"


def test_frames_not_flushed_are_counted_by_the_writer_only(
    place: FilePath, hook_chain: Chain, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(timeline_module, "MIN_FLUSH_PERIOD_S", 1e9)
    writer = TimelineWriter.create(place, hook_chain)
    writer.append(some_frames(3))  # the first frames are flushed immediately
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

    def mark_slowly(status: timeline_module.Status) -> None:
        nonlocal now
        mark(status)
        flushes.append(now)
        now += 0.03 if now < 3.0 else 2.0

    monkeypatch.setattr(writer, "_mark", mark_slowly)
    for k in range(120):
        now += 0.05
        writer.append(some_frames(1, start=k))
    cheap = np.diff([at for at in flushes if at < 3.0])
    dear = np.diff([at for at in flushes if at > 3.0])
    assert 0.15 < cheap[0] < 0.25  # readers wait for the start
    assert ((cheap[1:] > 0.32) & (cheap[1:] < 0.4)).all()  # at most a tenth of the time
    assert ((dear > 2.9) & (dear < 3.2)).all()  # at most a second apart


def test_killed_writer_leaves_only_complete_frames(
    place: FilePath, hook_chain: Chain, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = TimelineWriter.create(place, hook_chain)
    writer.append(some_frames(5))
    writer.flush()
    # The writer is killed after the columns have grown and before the count is written.
    monkeypatch.setattr(writer, "_mark", Mock(side_effect=KeyboardInterrupt))
    writer.append(some_frames(7, start=5))
    with pytest.raises(KeyboardInterrupt):
        writer.flush()
    timeline = Timeline.open(place)
    assert (len(timeline), timeline.status) == (5, "growing")
    assert_same(timeline.frames(), some_frames(5))
    with pytest.raises(TimelineError, match="within the timeline's 5 frames"):
        timeline.frames(0, 6)

    with TimelineWriter.reopen(place) as second_writer:
        second_writer.append(some_frames(2, start=90))
    assert Timeline.open(place).frames().time_s.tolist() == [0.0, 0.1, 0.2, 0.3, 0.4, 9.0, 9.1]


def test_reopened_writer_continues_after_the_frames_it_keeps(
    place: FilePath, hook_chain: Chain
) -> None:
    write_timeline(place, hook_chain, some_frames(200))
    with TimelineWriter.reopen(place, frames=130) as writer:
        assert len(writer) == 130
        assert Timeline.open(place).status == "growing"
        writer.append(some_frames(20, start=500))
    times = Timeline.open(place).frames().time_s
    np.testing.assert_array_equal(times, np.r_[np.arange(130), np.arange(500, 520)] / 10)
    check_folder(place)
    for frame_index in (-1, 151):
        with pytest.raises(TimelineError, match="expected 0 to 150"):
            TimelineWriter.reopen(place, frames=frame_index)


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
    with pytest.raises(TimelineError, match="only to a growing timeline"):
        writer.append(some_frames(1))


def test_range_outside_is_refused(five: FilePath) -> None:
    for wrong in ((-1, 2, 1), (0, 6, 1), (3, 2, 1), (0, 5, 0)):
        with case(wrong), pytest.raises(TimelineError, match="5 frames"):
            Timeline.open(five).frames(*wrong)


def test_missing_timeline_raises(place: FilePath) -> None:
    with pytest.raises(TimelineError, match="no timeline at"):
        Timeline.open(place)
    place.mkdir()
    with pytest.raises(TimelineError, match="no timeline at"):
        Timeline.open(place)


def test_timeline_of_an_earlier_version_is_refused_with_the_remedy(place: FilePath) -> None:
    place.with_name("timeline.zarr").mkdir()
    with pytest.raises(TimelineError, match="earlier version of foldback.*Fold the shape again"):
        Timeline.open(place)


def test_timeline_with_other_attributes_raises(five: FilePath, hook_chain: Chain) -> None:
    head, chain = read_head(five), chain_attributes(hook_chain)
    for name, value, words in (
        *((name, None, None) for name in ("format", "chunks", "chain", "status", "files")),
        ("format", "foldback-timeline/9", "foldback-timeline/9"),
        ("chunks", [{"frames": 9, "has_errors": False}], "declares 9 frames but has 5"),
        ("chunks", [{"frames": -1, "has_errors": False}], "a chunk without frames"),
        ("chunks", [{"frames": 5, "has_errors": False}] * 2, "000001.npz is damaged"),
        ("status", "gone", "is damaged"),
        ("chain", {}, "is damaged"),
        ("chain", {**chain, "module": "cubxe"}, "is damaged"),
        ("chain", chain_attributes(Chain.from_path(LINE)), "rows of shape"),
    ):
        values = {**head, name: value}
        if value is None:
            del values[name]
        write_head(five, values)
        with case((name, value)), pytest.raises(TimelineError, match=words):
            Timeline.open(five).frames()


def test_chunk_cannot_make_its_reader_allocate_more_than_it_holds(five: FilePath) -> None:
    """Files that state huge arrays, or unpack to much more than 256 MiB."""
    header = {"descr": "<f8", "fortran_order": False, "shape": (10**12,)}
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, header)
    for member, words in ((stream.getvalue(), "does not hold"), (bytes(2**28 + 1), "at most")):
        with ZipFile(five / "000000.npz", "w", ZIP_DEFLATED) as file:
            file.writestr("time_s.npy", member)
            members = [(info.filename, info.CRC, info.file_size) for info in file.infolist()]
        head = read_head(five)
        head["files"]["000000.npz"] = zlib.crc32(json.dumps(members).encode())
        write_head(five, head)
        tracemalloc.start()
        with case(words), pytest.raises(DamagedError, match=words):
            Timeline.open(five).clock()
        assert tracemalloc.get_traced_memory()[1] < 2**22
        tracemalloc.stop()


def test_timeline_that_loses_frames_has_another_id(place: FilePath, hook_chain: Chain) -> None:
    write_timeline(place, hook_chain, some_frames(9))
    reader = Timeline.open(place)
    with TimelineWriter.reopen(place) as writer:
        writer.append(some_frames(3, start=9))
    assert Timeline.open(place).id == reader.id
    assert not reader.replaced
    with TimelineWriter.reopen(place, frames=2):
        pass
    assert Timeline.open(place).id != reader.id
    assert reader.replaced
    with pytest.raises(TimelineError, match="replaced by a new one"):
        reader.refresh()
    assert_same(Timeline.open(place).frames(), some_frames(2))


def test_chunks_without_a_wanted_frame_are_not_read(place: FilePath, hook_chain: Chain) -> None:
    write_timeline(place, hook_chain, some_frames(400))
    (place / "000001.npz").write_bytes(b"damaged")
    timeline = Timeline.open(place)
    assert_same(timeline.frames(0, 400, 300), some_frames(400)[0:400:300])
    with pytest.raises(DamagedError, match=r"000001\.npz is damaged"):
        timeline.frames(0, 400, 100)


@pytest.mark.parametrize("name", ["time_s", "joint_angles_rad", "root_wxyz"])
def test_changed_column_is_noticed(five: FilePath, name: str) -> None:
    """The other columns can still be read."""
    file = five / "000000.npz"
    data = bytearray(file.read_bytes())
    with ZipFile(file) as opened:
        info = opened.getinfo(f"{name}.npy")
    at = info.header_offset + 30 + len(info.filename) + 20  # behind its local header
    data[at + info.compress_size // 2] ^= 16
    file.write_bytes(data)
    with pytest.raises(DamagedError, match="Bad CRC-32|while decompressing|does not hold"):
        Timeline.open(five).frames()
    if name != "time_s":
        assert len(Timeline.open(five).clock()[0]) == 5


def test_timeline_with_damaged_chunk_raises(place: FilePath, hook_chain: Chain) -> None:
    played = some_frames(130, start=130, phase="playback", error=True)
    file = write_timeline(place, hook_chain, some_frames(130), played) / "000000.npz"
    chunk, foreign = file.read_bytes(), (place / "000001.npz").read_bytes()
    damages = {"truncated": chunk[:-9], "empty": b"", "foreign": foreign}
    for name, data in {**damages, "missing": None, "directory": None}.items():
        file.unlink()
        if data is not None:
            file.write_bytes(data)
        elif name == "directory":
            file.mkdir()
        for read in (lambda: Timeline.open(place).frames(), lambda: check_folder(place)):
            with case(name), pytest.raises(DamagedError, match=r"000000\.npz is damaged"):
                read()
        if name == "missing":
            file.touch()


def test_timeline_with_damaged_head_raises(five: FilePath) -> None:
    file = five / "head.json"
    head = file.read_bytes()
    changed = [head[:k] + bytes([head[k] ^ 1]) + head[k + 1 :] for k in range(3, len(head), 97)]
    for data in (head[:50], b"", b"{}", *changed):
        file.write_bytes(data)
        with case(data), pytest.raises(DamagedError, match="head.json is damaged"):
            Timeline.open(five)


def test_writer_continues_only_after_an_undamaged_tail(five: FilePath) -> None:
    (five / "000000.npz").unlink()
    with pytest.raises(DamagedError):
        TimelineWriter.reopen(five)


def test_folded_angles_of_a_windowed_timeline_are_checked(
    place: FilePath, hook_chain: Chain
) -> None:
    with TimelineWriter.create(place, hook_chain, windowed=True) as writer:
        writer.append(some_frames(3).windowed(hook_chain))
    np.testing.assert_array_equal(Timeline.open(place).chain.folded_rad, hook_chain.folded_rad)
    save_npz(place / "folded.npz", {"folded_rad": np.zeros(6)})
    with pytest.raises(DamagedError, match="folded.npz is damaged: .*checksum"):
        Timeline.open(place)
