"""Timeline: the frames of one fold in time order, append-only while it runs, tail-readable.

It holds the motions of the explosion and of the playback, and is the only thing that passes from
the computing side to the showing side. On disk it is an array folder
(``planner.storage.array_files``). Each flush writes *chunks*: ``.npz`` files with the columns of a
``Motion`` for consecutive frames, which never change. The head, which lists the chunks, is written
last; a reader never sees half a frame.

The layout is that of a dense or of a windowed ``Motion``. Either is read as the one or the other.
"""

from __future__ import annotations

import secrets
import time
from bisect import bisect_right
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import accumulate
from pathlib import Path as FilePath
from shutil import rmtree
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.chain_attributes import chain_attributes, chain_from_attributes
from foldback.planner.errors import UNREADABLE, DamagedError, InputError, TimelineError
from foldback.planner.motion.motion import EXPLOSION, FRAME_COLUMNS, WINDOW_COLUMNS, Motion
from foldback.planner.storage.array_files import (
    HEAD,
    Arrays,
    read_arrays,
    read_head,
    save_npz,
    write_head,
)
from foldback.planner.storage.file_names import EARLIER_FILES, TIMELINE
from foldback.planner.storage.plain_values import from_plain, to_plain

FORMAT: Final = "foldback-timeline/3"
Layout = Literal["frames", "windows"]
Status = Literal["growing", "complete", "failed"]
MAX_CHUNK_FRAMES: Final = {"frames": 128, "windows": 4096}
"""Maximum number of frames in a chunk, by layout."""
MAX_CHUNK_ANGLES: Final = 2**18
"""Maximum number of hinge angles in a chunk, unless it holds a single frame."""
MIN_FLUSH_PERIOD_S: Final = 0.15
"""Minimum time between two writes of new frames to disk, s."""
MAX_FLUSH_PERIOD_S: Final = 1.0
"""Maximum time between two writes of new frames to disk, s, even if writes are slow."""
EARLIER: Final = (
    "got a fold of an earlier version of foldback, which stored motions in another format. Fold "
    "the shape again."
)
FOLDED_FILE: Final = "folded.npz"
"""File in a windowed timeline with the folded angles of its chain. The head is written and read
over and over; such a chain may have a million hinges."""


@dataclass(frozen=True, slots=True)
class _Chunk:
    """Entry of a chunk in the head.

    Attributes:
        frames: Number of its frames that belong to the timeline; the file may hold more.
        has_errors: True if it holds joint errors.
    """

    frames: int
    has_errors: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class _Head:
    """Values in the head of a timeline.

    Attributes:
        format: ``FORMAT``.
        layout: Layout of its motion.
        id: Random text that tells a timeline that was begun anew from the one before.
        chain: Values of ``chain_attributes``; for windows without angles and joint names.
        status: ``growing`` until the last frame is there.
        chunks: Chunks in time order.
        files: Checksums by name of the file.
    """

    format: str
    layout: Layout
    id: str
    chain: dict[str, Any]
    status: Status
    chunks: tuple[_Chunk, ...]
    files: dict[str, int]

    @property
    def frames(self) -> int:
        return sum(chunk.frames for chunk in self.chunks)


def is_earlier(directory: FilePath) -> bool:
    """Return True if a directory holds a fold of an earlier version."""
    return (directory / EARLIER_FILES[0]).exists() and not (directory / TIMELINE).exists()


def frames_on_disk(path: FilePath) -> int:
    """Return the number of frames that the timeline at a path states.

    Raises:
        TimelineError: There is none, or it is damaged.
    """
    return _read(path).frames


class TimelineWriter:
    """Writer that appends frames to a timeline. One at a time; a context manager."""

    def __init__(self, path: FilePath, head: _Head, hinges: int) -> None:
        self._path = path
        self._head = head
        self._frames = head.frames
        self._hinges = hinges
        self._waiting: list[Motion] = []
        self._next_flush = time.monotonic()  # the first frames are shown at once
        self._mark("growing")

    @classmethod
    def create(
        cls,
        path: str | FilePath,
        chain: Chain,
        *,
        windowed: bool = False,
        timeline_id: str | None = None,
    ) -> TimelineWriter:
        """Return the writer of a new, empty timeline; it replaces what was at ``path``.

        Args:
            path: Directory of the timeline.
            chain: Chain whose frames it holds.
            windowed: True if its motions are windowed; else they are dense.
            timeline_id: Identity of the timeline if it is a copy; a new one if None.
        """
        folder = FilePath(path)
        # First of all: a reader of frames whose files are being deleted sees that by its absence.
        (folder / HEAD).unlink(missing_ok=True)
        rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        chain_values, files = chain_attributes(chain), dict[str, int]()
        if windowed:
            for name in ("folded_rad", "joint_names"):
                del chain_values[name]
            files[FOLDED_FILE] = save_npz(folder / FOLDED_FILE, {"folded_rad": chain.folded_rad})
        head = _Head(
            format=FORMAT,
            layout="windows" if windowed else "frames",
            id=timeline_id or secrets.token_hex(8),
            chain=chain_values,
            status="growing",
            chunks=(),
            files=files,
        )
        return cls(folder, head, len(chain.folded_rad))

    @classmethod
    def reopen(cls, path: str | FilePath, *, frames: int | None = None) -> TimelineWriter:
        """Continue a timeline after its first ``frames`` frames (all of them when None)."""
        folder, timeline = FilePath(path), Timeline.open(path)
        frame_count = len(timeline) if frames is None else frames
        if not 0 <= frame_count <= len(timeline):
            raise TimelineError(
                f"got {frame_count} frames to keep, expected 0 to {len(timeline)}, the number of "
                f"frames in {path}."
            )
        timeline.motion(max(frame_count - 1, 0), frame_count)  # nothing follows a damaged chunk
        head = _read(folder)
        if frame_count < len(timeline):
            remaining_chunks: list[_Chunk] = []
            for chunk, end in zip(head.chunks, _ends(head.chunks), strict=True):
                if end - chunk.frames < frame_count:
                    frames_of_chunk = chunk.frames - max(end - frame_count, 0)
                    remaining_chunks.append(replace(chunk, frames=frames_of_chunk))
            names = {FOLDED_FILE, *map(_chunk_file, range(len(remaining_chunks)))}
            files = {name: checksum for name, checksum in head.files.items() if name in names}
            # Readers of the dropped frames must start again.
            head = replace(
                head, chunks=tuple(remaining_chunks), files=files, id=secrets.token_hex(8)
            )
        writer = cls(folder, head, len(timeline.chain.folded_rad))
        for file in folder.glob("*.npz"):
            if file.name not in head.files:
                file.unlink()
        return writer

    def __enter__(self) -> TimelineWriter:
        return self

    def __exit__(self, kind: object, value: object, trace: object) -> None:
        if self._head.status == "growing":
            self.close("failed" if kind else "complete")

    def __len__(self) -> int:
        return self._frames + sum(len(w) for w in self._waiting)

    def append(self, frames: Motion) -> None:
        """Add frames; they reach the disk within ``MAX_FLUSH_PERIOD_S`` of further calls.

        Raises:
            TimelineError: They are of another kind or of another chain.
        """
        if self._head.status != "growing":
            raise TimelineError(
                f"the timeline is {self._head.status}; frames can be added only to a growing "
                "timeline."
            )
        if frames.layout != self._head.layout:
            names = {"frames": "a dense motion", "windows": "a windowed motion"}
            raise TimelineError(f"got {names[frames.layout]}, expected {names[self._head.layout]}.")
        hinges = int(frames.last.max(initial=0)) if frames.is_windowed else frames.hinges or 0
        if hinges > self._hinges or (hinges < self._hinges and not frames.is_windowed):
            raise TimelineError(
                f"got frames of {hinges} joint angles, expected {self._hinges} joint angles, as "
                "many as the timeline's chain has."
            )
        if len(frames):
            self._waiting.append(frames)
        if time.monotonic() >= self._next_flush:
            self.flush()

    def flush(self) -> None:
        """Write waiting frames and make them visible to readers."""
        start_s = time.monotonic()
        self._next_flush = start_s + MIN_FLUSH_PERIOD_S
        if not self._waiting:
            return
        # A motion of a million modules is not copied.
        motion = self._waiting[0] if len(self._waiting) == 1 else Motion.joined(self._waiting)
        self._waiting = []
        first = not self._frames
        chunks, files = list(self._head.chunks), dict(self._head.files)
        for part in _parts(motion):
            columns, has_errors = part.columns(), part.errors_rad is not None
            if not has_errors:
                columns.pop("joint_error_rad", None)
            name = _chunk_file(len(chunks))
            files[name] = save_npz(self._path / name, columns)
            chunks.append(_Chunk(len(part), has_errors))
        self._head = replace(self._head, chunks=tuple(chunks), files=files)
        self._frames += len(motion)
        self._mark("growing")
        now = time.monotonic()
        # Nothing moves before the second one. A tenth of the time at most.
        pause = 0.0 if first else min((now - start_s) / 0.1, MAX_FLUSH_PERIOD_S)
        self._next_flush = now + max(pause, MIN_FLUSH_PERIOD_S)

    def close(self, status: Status = "complete") -> None:
        """Write waiting frames and close the timeline for good."""
        self.flush()
        self._mark(status)

    def _mark(self, status: Status) -> None:
        self._head = replace(self._head, status=status)
        write_head(self._path, to_plain(self._head))


class Timeline:
    """Reader of a timeline, also of its tail while it grows."""

    def __init__(self, path: FilePath, head: _Head) -> None:
        self.path = path
        self.id = head.id
        self.windowed = head.layout == "windows"
        self.chain_data = dict(head.chain)
        if self.windowed:
            folded = read_arrays(path / FOLDED_FILE, head.files.get(FOLDED_FILE, 0))
            self.chain_data["folded_rad"] = folded["folded_rad"].tolist()
        self.chain = chain_from_attributes(self.chain_data)
        self._take(head)

    @classmethod
    def open(cls, path: str | FilePath) -> Timeline:
        """Open a timeline.

        Raises:
            TimelineError: There is none, or another one is replacing it.
            DamagedError: It is damaged.
        """
        folder = FilePath(path)
        head = _read(folder)
        with _reading(folder, head.id):
            return cls(folder, head)

    def __len__(self) -> int:
        """Return the number of frames at the last ``refresh``."""
        return self._ends[-1] if self._ends else 0

    @property
    def chunk_frames(self) -> int:
        """Maximum number of frames in a chunk: longer ranges take more than one read."""
        return MAX_CHUNK_FRAMES[self._head.layout]

    @property
    def status(self) -> Status:
        """Status at the last ``refresh``: ``growing``, ``complete`` or ``failed``."""
        return self._head.status

    def refresh(self) -> bool:
        """Check for new frames; return True if anything has changed.

        Raises:
            TimelineError: Another one has replaced it, or is about to.
        """
        before = self._head
        head = _read(self.path)
        if head.id != self.id:
            raise TimelineError(f"the timeline at {self.path} was replaced by a new one.")
        self._take(head)
        return before != head

    @property
    def replaced(self) -> bool:
        """True if another timeline has replaced it, or is about to."""
        return _is_replaced(self.path, self.id)

    def motion(self, start: int = 0, stop: int | None = None, stride: int = 1) -> Motion:
        """Read frames ``start`` to ``stop`` (to the end if None), every ``stride``-th one.

        Raises:
            TimelineError: The range is not within the timeline.
        """
        end = self._end(start, stop, stride)
        with _reading(self.path, self.id):
            parts = [
                Motion.from_columns(self._columns(number))[rows]
                for number, rows in self._rows(start, end, stride)
            ]
        if parts:
            return Motion.joined(parts)
        if not self.windowed:
            return Motion.empty(len(self.chain.folded_rad))
        nothing = np.zeros(0, np.int64)
        return Motion.from_angles(np.zeros(0, np.float32), nothing, np.zeros(1, np.int64))

    def explosion(self) -> Motion:
        """Read the frames of the explosion."""
        return self.motion(0, self._exploded())

    def playback(self) -> Motion:
        """Read the frames of the playback, and of the unfolding before it."""
        return self.motion(self._exploded())

    def _exploded(self) -> int:
        """Return the number of frames of the explosion; they are the first ones."""
        return int((self.clock()[1] == EXPLOSION).sum())

    def frames(self, start: int = 0, stop: int | None = None, stride: int = 1) -> Motion:
        """Read frames as a dense motion, see ``motion``."""
        return self.motion(start, stop, stride).dense(self.chain)

    def windows(self, start: int = 0, stop: int | None = None, stride: int = 1) -> Motion:
        """Read frames as a windowed motion, see ``motion``."""
        return self.motion(start, stop, stride).windowed(self.chain)

    @property
    def tells_errors(self) -> bool:
        """True if joint errors of any frame may be recorded; those of windows are not read."""
        return not self.windowed or any(chunk.has_errors for chunk in self._head.chunks)

    def largest_errors(self, start: int = 0, stop: int | None = None) -> Array:
        """Return the (f,) largest joint error of each frame, NaN if none is recorded.

        Chunks without any recorded error are not read.

        Raises:
            TimelineError: The range is not within the timeline.
        """
        end = self._end(start, stop, 1)
        largest = np.full(end - start, np.nan)
        with _reading(self.path, self.id):
            for number, rows in self._rows(start, end, 1):
                if self._head.chunks[number].has_errors:
                    motion = Motion.from_columns(self._columns(number))[rows]
                    at = self._start(number) + rows.start - start
                    largest[at : at + len(motion)] = motion.largest_errors
        return largest

    def clock(self, start: int = 0) -> tuple[Array, NDArray[np.uint8]]:
        """Return (f,) times and (f,) phases of all frames from ``start`` on, nothing else."""
        names = ("time_s", "phase")
        with _reading(self.path, self.id):
            parts = [
                (self._columns(number, names), rows)
                for number, rows in self._rows(start, len(self), 1)
            ]
        time_s = [columns["time_s"][rows] for columns, rows in parts]
        phase = [columns["phase"][rows] for columns, rows in parts]
        return np.concatenate([np.zeros(0), *time_s]), np.concatenate(
            [np.zeros(0, np.uint8), *phase]
        )

    def _rows(self, start: int, end: int, stride: int) -> Iterator[tuple[int, slice]]:
        """Yield the number of each chunk that holds wanted frames, and their rows in it."""
        frame = start
        while frame < end:
            number = bisect_right(self._ends, frame)
            first, last = self._start(number), min(self._ends[number], end)
            yield number, slice(frame - first, last - first, stride)
            frame += -(-(last - frame) // stride) * stride

    def _start(self, number: int) -> int:
        return self._ends[number] - self._head.chunks[number].frames

    def _columns(self, number: int, names: Sequence[str] | None = None) -> Arrays:
        """Return columns of a chunk, all if ``names`` is None.

        Raises:
            DamagedError: Its file is missing or damaged.
        """
        chunk, path = self._head.chunks[number], self.path / _chunk_file(number)
        arrays = read_arrays(path, self._head.files.get(path.name, 0), names)
        expected = WINDOW_COLUMNS if self.windowed else FRAME_COLUMNS
        for name, array in arrays.items():
            tail, dtype = expected[name]
            tail = tuple(len(self.chain.folded_rad) if size < 0 else size for size in tail)
            if array.shape[1:] != tail or array.dtype != dtype or array.ndim != 1 + len(tail):
                raise DamagedError(
                    path,
                    f"got {array.dtype} rows of shape {array.shape[1:]} as {name}, expected "
                    f"{dtype} rows of shape {tail}",
                )
        if len(arrays["time_s"]) < chunk.frames:
            raise DamagedError(
                path,
                f"the timeline declares {chunk.frames} frames but has {len(arrays['time_s'])}",
            )
        return arrays

    def _end(self, start: int, stop: int | None, stride: int) -> int:
        end = len(self) if stop is None else stop
        if not (0 <= start <= end <= len(self) and stride >= 1):
            raise TimelineError(
                f"got frames {start} to {end} in steps of {stride}, expected a range within the "
                f"timeline's {len(self)} frames and a step of at least 1."
            )
        return end

    def _take(self, head: _Head) -> None:
        self._head = head
        self._ends = _ends(head.chunks)


def _ends(chunks: Sequence[_Chunk]) -> list[int]:
    """Return the number of frames up to the end of each chunk."""
    return list(accumulate(chunk.frames for chunk in chunks))


def _chunk_file(number: int) -> str:
    return f"{number:06}.npz"


def _parts(motion: Motion) -> Iterator[Motion]:
    """Yield the chunks of a motion."""
    start = 0
    while start < len(motion):
        until = int(np.searchsorted(motion.offsets, motion.offsets[start] + MAX_CHUNK_ANGLES))
        stop = min(max(until - 1, start + 1), start + MAX_CHUNK_FRAMES[motion.layout])
        yield motion[start:stop]
        start = stop


@contextmanager
def _reading(path: FilePath, timeline_id: str) -> Generator[None]:
    """Turn what reading raises into DamagedError, or TimelineError if it is being replaced."""
    try:
        yield
    except (DamagedError, InputError, *UNREADABLE) as error:
        if _is_replaced(path, timeline_id):
            raise TimelineError(f"the timeline at {path} was replaced by a new one.") from error
        if isinstance(error, DamagedError):
            raise
        raise DamagedError(path, f"{type(error).__name__}: {error}") from error


def _is_replaced(path: FilePath, timeline_id: str) -> bool:
    try:
        return _read(path).id != timeline_id
    except DamagedError:
        return False
    except TimelineError:
        return True


def _read(path: FilePath) -> _Head:
    """Return the head of the timeline at a path.

    Raises:
        TimelineError: There is none, or it has another format.
        DamagedError: It is damaged.
    """
    try:
        values = read_head(path)
    except FileNotFoundError as error:
        if is_earlier(path.parent):
            raise TimelineError(f"{path.parent}: {EARLIER}") from error
        raise TimelineError(f"no timeline at {path}: {error}") from error
    if values.get("format") != FORMAT:
        raise TimelineError(
            f"got the format {values.get('format')!r} at {path}, expected {FORMAT!r}."
        )
    try:
        head = from_plain(values, _Head)
    except ValueError as error:
        raise DamagedError(path / HEAD, str(error)) from error
    if any(chunk.frames < 1 for chunk in head.chunks):
        raise DamagedError(path / HEAD, "it lists a chunk without frames")
    return head
