"""Timeline: time-ordered snapshots of one fold, append-only while it runs, tail-readable.

It is the only thing that passes from the computing side to the showing side. On disk it is a zarr
group. Frames become visible to readers when the group's ``frames`` attribute has grown, which is
written last; a reader never sees half a frame.

The format names the layout: that of a dense or of a windowed ``Motion``. Either is read as the one
or the other.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, Final, Literal, cast

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.chain_attributes import chain_attributes, chain_from_attributes
from foldback.planner.errors import UNREADABLE, DamagedError, InputError, TimelineError
from foldback.planner.motion.motion import FRAME_COLUMNS, WINDOW_COLUMNS, Columns, Motion
from foldback.planner.storage.checked_zarr import (
    ROOT_FILE,
    array_of,
    checksums_of,
    create_array,
    create_group,
    open_for_writing,
    read_group,
    sealed,
)

if TYPE_CHECKING:
    import zarr

FORMAT: Final = "foldback-timeline/1"
WINDOWS_FORMAT: Final = "foldback-timeline/2"
Status = Literal["growing", "complete", "failed"]
ERRORS_FROM: Final = "errors_from"
"""Name of the attribute of a stored motion that gives the index of the first hinge angle with a
recorded tracking error, or None if there is none: readers need not read the errors before it."""
FRAMES_PER_CHUNK: Final = 128
"""Number of frames in a zarr chunk of a motion that stores all hinges in each frame."""
WINDOWS_PER_CHUNK: Final = 4096
"""Number of frames in a zarr chunk of a motion that stores only the moving hinges of each frame,
for all arrays but those of angles."""
MIN_FLUSH_PERIOD_S: Final = 0.15
"""Minimum time between two writes of new frames to disk, s."""
MAX_FLUSH_PERIOD_S: Final = 1.0
"""Maximum time between two writes of new frames to disk, s, even if writes are slow."""


_WINDOW_ROWS: Final = ("time_s", "phase", "first", "base_position", "base_wxyz")
_WINDOW_ANGLES: Final = ("angles_rad", "errors_rad")


def _columns(windowed: bool, hinges: int) -> dict[str, tuple[tuple[int, ...], str, int]]:
    """Return shape behind the first axis, type, and chunk rows of the columns by name.

    ``ends`` are the ends of the windows in ``angles_rad``. Joint errors are single precision.
    """
    table: Columns = {**FRAME_COLUMNS, "joint_error_rad": ((-1,), "float32")}
    if windowed:
        names = (*_WINDOW_ROWS[:3], "offsets", *_WINDOW_ROWS[3:], *_WINDOW_ANGLES)
        table = {"ends" if name == "offsets" else name: WINDOW_COLUMNS[name] for name in names}
    rows: dict[str, int] = {name: 2**16 for name in _WINDOW_ANGLES}
    chunk_rows = WINDOWS_PER_CHUNK if windowed else FRAMES_PER_CHUNK
    return {
        name: (
            tuple(hinges if size < 0 else size for size in tail),
            dtype,
            rows.get(name, chunk_rows),
        )
        for name, (tail, dtype) in table.items()
    }


class TimelineWriter:
    """Writer that appends frames to a timeline. One at a time; a context manager."""

    def __init__(
        self,
        path: str | FilePath,
        group: zarr.Group,
        arrays: dict[str, zarr.Array[Any]],
        attributes: dict[str, Any],
    ) -> None:
        self._path = path
        self._group = group
        self._arrays = arrays
        self._attributes = attributes
        self._frames = int(attributes["frames"])
        self._windowed = attributes["format"] == WINDOWS_FORMAT
        self._hinges = (
            arrays["folded_rad"].size if self._windowed else len(attributes["chain"]["folded_rad"])
        )
        self._waiting: list[Motion] = []
        self._next_flush = time.monotonic()  # the first frames are shown at once
        self._status: Status = "growing"

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
        # First of all: a reader of frames whose files are being deleted sees that by its absence.
        (FilePath(path) / ROOT_FILE).unlink(missing_ok=True)
        group = create_group(path)
        columns = _columns(windowed, len(chain.folded_rad))
        arrays = {
            name: create_array(
                group,
                name,
                shape=(0, *tail),
                chunks=(rows, *tail),
                dtype=dtype,
                fill_value=np.nan if name == "errors_rad" else 0,
            )
            for name, (tail, dtype, rows) in columns.items()
        }
        chain_values = chain_attributes(chain)
        errors: dict[str, Any] = {}
        if windowed:
            # The attributes are written and read over and over: what is long is beside them.
            folded = chain.folded_rad
            arrays["folded_rad"] = create_array(
                group,
                "folded_rad",
                shape=folded.shape,
                chunks=(max(1, len(folded)),),
                dtype=folded.dtype,
            )
            arrays["folded_rad"][:] = folded
            for name in ("folded_rad", "joint_names"):
                del chain_values[name]
            errors = {ERRORS_FROM: None}
        attributes = {
            "format": WINDOWS_FORMAT if windowed else FORMAT,
            # Tells a timeline that was begun anew from the one that was there before.
            "id": timeline_id or secrets.token_hex(8),
            "chain": chain_values,
            **errors,
            "frames": 0,
            "status": "growing",
        }
        writer = cls(path, group, arrays, sealed(attributes))
        writer._mark("growing")
        return writer

    @classmethod
    def reopen(cls, path: str | FilePath, *, frames: int | None = None) -> TimelineWriter:
        """Continue a timeline after its first ``frames`` frames (all of them when None)."""
        timeline = Timeline.open(path)
        frame_count = len(timeline) if frames is None else frames
        if not 0 <= frame_count <= len(timeline):
            raise TimelineError(
                f"got {frame_count} frames to keep, expected 0 to {len(timeline)}, the number of "
                f"frames in {path}."
            )
        timeline.motion(
            max(frame_count - 1, 0), frame_count
        )  # a damaged chunk must not be written again
        group, arrays = open_for_writing(path)
        attributes = {**group.attrs.asdict(), "frames": frame_count}
        if frame_count < len(timeline):
            # Who has read what is dropped has to begin anew.
            attributes["id"] = secrets.token_hex(8)
        writer = cls(path, group, arrays, attributes)
        writer._mark("growing")
        return writer

    def __enter__(self) -> TimelineWriter:
        return self

    def __exit__(self, kind: object, value: object, trace: object) -> None:
        if self._status == "growing":
            self.close("failed" if kind else "complete")

    def __len__(self) -> int:
        return self._frames + sum(len(w) for w in self._waiting)

    def append(self, frames: Motion) -> None:
        """Add frames; they reach the disk within ``MAX_FLUSH_PERIOD_S`` of further calls.

        Raises:
            TimelineError: They are of another kind or of another chain.
        """
        if self._status != "growing":
            raise TimelineError(
                f"the timeline is {self._status}; frames can be added only to a growing timeline."
            )
        if frames.is_windowed != self._windowed:
            names = ("a dense motion", "a windowed motion")
            raise TimelineError(
                f"got {names[frames.is_windowed]}, expected {names[self._windowed]}."
            )
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
        motion = Motion.joined(self._waiting)
        self._waiting = []
        first = not self._frames
        stop = self._frames + len(motion)
        values = motion.columns()
        if motion.is_windowed:
            begins = int(cast("Any", self._arrays["ends"][self._frames - 1])) if self._frames else 0
            self._write_angles(motion, begins)
            values = {name: values[name] for name in _WINDOW_ROWS}
            values["ends"] = begins + motion.offsets[1:]
        for name, column in values.items():
            array = self._arrays[name]
            array.resize((stop, *array.shape[1:]))
            array[self._frames : stop] = column.astype(array.dtype)
        self._frames = stop
        self._mark("growing")
        now = time.monotonic()
        # Nothing moves before the second one, and the first takes long: it creates the files.
        # a tenth of the time at most
        pause = 0.0 if first else min((now - start_s) / 0.1, MAX_FLUSH_PERIOD_S)
        self._next_flush = now + max(pause, MIN_FLUSH_PERIOD_S)

    def _write_angles(self, motion: Motion, begins: int) -> None:
        """Write the angles of windows, and their errors from the first recorded one on.

        Args:
            motion: The windows.
            begins: Number of angles before them.
        """
        count = begins + len(motion.angles_rad)
        self._arrays["angles_rad"].resize((count,))
        self._arrays["angles_rad"][begins:] = motion.angles_rad
        errors = self._arrays["errors_rad"]
        errors.resize((count,))
        first = self._attributes.get(ERRORS_FROM)
        if first is not None and first >= begins:  # those were dropped when it was reopened
            first = None
        if motion.errors_rad is not None:
            errors[begins:] = motion.errors_rad
            first = begins if first is None else first
        elif first is not None:
            errors[begins:] = np.nan
        self._attributes[ERRORS_FROM] = first

    def close(self, status: Status = "complete") -> None:
        """Write waiting frames and close the timeline for good."""
        self.flush()
        self._mark(status)

    def _mark(self, status: Status) -> None:
        self._status = status
        self._attributes |= {"frames": self._frames, "status": status}
        over = status != "growing"
        self._attributes = sealed(
            self._attributes, checksums_of(self._path, self._arrays) if over else None
        )
        self._group.attrs.put(self._attributes)


class Timeline:
    """Reader of a timeline, also of its tail while it grows."""

    def __init__(self, path: str, attributes: dict[str, Any]) -> None:
        self.path = path
        self.id = str(attributes["id"])
        self.windowed = attributes["format"] == WINDOWS_FORMAT
        self._arrays: dict[str, zarr.Array[Any]] = {}
        self._frames = 0
        self._status: Status = "growing"
        self._errors_from: int | None = None
        chain_data = attributes["chain"]
        if self.windowed:
            folded = cast("zarr.Array[Any]", read_group(path)["folded_rad"])
            chain_data = {**chain_data, "folded_rad": np.asarray(folded[:]).tolist()}
        self.chain_data = dict(chain_data)
        self.chain = chain_from_attributes(chain_data)
        self._take(attributes)

    @classmethod
    def open(cls, path: str | FilePath) -> Timeline:
        """Open a timeline.

        Raises:
            TimelineError: There is none, or another one is replacing it.
            DamagedError: It is damaged.
        """
        attributes = _attributes(str(path))
        with _reading(str(path), attributes["id"]):
            return cls(str(path), attributes)

    def __len__(self) -> int:
        """Return the number of frames at the last ``refresh``."""
        return self._frames

    @property
    def chunk_frames(self) -> int:
        """Number of frames in a chunk: ranges of whole chunks are read fastest."""
        return WINDOWS_PER_CHUNK if self.windowed else FRAMES_PER_CHUNK

    @property
    def status(self) -> Status:
        """Status at the last ``refresh``: ``growing``, ``complete`` or ``failed``."""
        return self._status

    def refresh(self) -> bool:
        """Check for new frames; return True if anything has changed.

        Raises:
            TimelineError: Another one has replaced it, or is about to.
        """
        before = (self._frames, self._status)
        attributes = _attributes(self.path)
        if attributes["id"] != self.id:
            raise TimelineError(f"the timeline at {self.path} was replaced by a new one.")
        with _reading(self.path, self.id):
            self._take(attributes)
        return before != (self._frames, self._status)

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
            read = self._windows if self.windowed else self._dense
            return Motion.from_columns(read(start, end, stride))

    def frames(self, start: int = 0, stop: int | None = None, stride: int = 1) -> Motion:
        """Read frames as a dense motion, see ``motion``."""
        return self.motion(start, stop, stride).dense(self.chain)

    def windows(self, start: int = 0, stop: int | None = None, stride: int = 1) -> Motion:
        """Read frames as a windowed motion, see ``motion``."""
        return self.motion(start, stop, stride).windowed(self.chain)

    def _dense(self, start: int, end: int, stride: int) -> dict[str, Any]:
        columns = {name: _strided(self._arrays[name], start, end, stride) for name in FRAME_COLUMNS}
        columns["joint_error_rad"] = columns["joint_error_rad"].astype(np.float64)
        return columns

    def _windows(self, start: int, end: int, stride: int) -> dict[str, Any]:
        numbers = np.arange(start, end, stride)
        ends = cast("Ints", self._arrays["ends"][max(start - 1, 0) : end])
        ends = np.concatenate([[0], ends]) if start == 0 else ends
        begins, stops = ends[numbers - start], ends[numbers - start + 1]
        if stride == 1 or not len(numbers):
            spans = [(int(ends[0]), int(ends[-1]))]
        else:
            spans = list(zip(begins.tolist(), stops.tolist(), strict=True))
        angles = cast("Any", self._arrays["angles_rad"])
        errors = np.concatenate([self._errors(first, last) for first, last in spans])
        return {
            **{name: cast("Any", self._arrays[name][start:end])[::stride] for name in _WINDOW_ROWS},
            "offsets": np.concatenate([[0], np.cumsum(stops - begins)]),
            "angles_rad": np.concatenate([angles[first:last] for first, last in spans]),
            "errors_rad": None if np.isnan(errors).all() else errors,
        }

    def _errors(self, first: int, last: int) -> NDArray[np.float32]:
        """Return errors of a range of angles, NaN before the first recorded one."""
        if self._errors_from is None:
            return np.full(last - first, np.nan, np.float32)
        error_start = min(max(first, self._errors_from), last)
        before = np.full(error_start - first, np.nan, np.float32)
        errors = cast("Any", self._arrays["errors_rad"])[error_start:last]
        return np.concatenate([before, errors])

    @property
    def tells_errors(self) -> bool:
        """True if joint errors of any frame may be recorded; those of windows are not read."""
        return not self.windowed or self._errors_from is not None

    def largest_errors(self, start: int = 0, stop: int | None = None) -> Array:
        """Return the (f,) largest joint error of each frame, NaN if none is recorded.

        Without any recorded error, no chunk is read.

        Raises:
            TimelineError: The range is not within the timeline.
        """
        end, rows = self._end(start, stop, 1), max(self.chunk_frames, 1024)
        if not self.tells_errors:
            return np.full(end - start, np.nan)
        parts = [
            self.motion(at, min(at + rows, end)).largest_errors for at in range(start, end, rows)
        ]
        return np.concatenate([np.zeros(0), *parts])

    def clock(self, start: int = 0) -> tuple[Array, NDArray[np.uint8]]:
        """Return (f,) times and (f,) phases of all frames from ``start`` on, nothing else."""
        with _reading(self.path, self.id):
            time_s, phase = (
                self._arrays[name][start : self._frames] for name in ("time_s", "phase")
            )
        return cast("Array", time_s), cast("NDArray[np.uint8]", phase)

    def _end(self, start: int, stop: int | None, stride: int) -> int:
        end = self._frames if stop is None else stop
        if not (0 <= start <= end <= self._frames and stride >= 1):
            raise TimelineError(
                f"got frames {start} to {end} in steps of {stride}, expected a range within the "
                f"timeline's {self._frames} frames and a step of at least 1."
            )
        return end

    def _take(self, attributes: dict[str, Any]) -> None:
        frames = int(attributes["frames"])
        status = cast("Status", attributes["status"])
        # A group that was opened while it grew knows no checksums of chunk files.
        if frames != self._frames or status != self._status or not self._arrays:
            group = read_group(self.path)
            columns = _columns(self.windowed, len(self.chain.folded_rad))
            self._arrays = {n: array_of(group, self.path, n) for n in columns}
            for name, array in self._arrays.items():
                tail, dtype, _ = columns[name]
                if array.shape[1:] != tail or array.dtype != dtype:
                    raise DamagedError(
                        FilePath(self.path) / name,
                        f"got {array.dtype} rows of shape {array.shape[1:]}, expected {dtype} rows "
                        f"of shape {tail}",
                    )
            rows = [a.shape[0] for n, a in self._arrays.items() if n not in _WINDOW_ANGLES]
            if not 0 <= frames <= min(rows):
                raise DamagedError(
                    self.path, f"the timeline declares {frames} frames but has {min(rows)}"
                )
        self._errors_from = attributes.get(ERRORS_FROM)
        self._frames = frames
        self._status = status


def _strided(array: zarr.Array[Any], start: int, end: int, stride: int) -> NDArray[Any]:
    """Return ``array[start:end:stride]``, read chunk by chunk if there is a stride."""
    if stride == 1:
        return cast("NDArray[Any]", array[start:end])
    frames = np.arange(start, end, stride)
    edges = np.flatnonzero(np.diff(frames // array.chunks[0])) + 1
    parts = [
        cast("NDArray[Any]", array[int(part[0]) : int(part[-1]) + 1])[::stride]
        for part in np.split(frames, edges)
        if len(part)
    ]
    return np.concatenate(parts) if parts else cast("NDArray[Any]", array[start:start])


@contextmanager
def _reading(path: str, timeline_id: str) -> Generator[None]:
    """Turn what reading raises into DamagedError, or TimelineError if it is being replaced."""
    try:
        yield
    except (DamagedError, InputError, *UNREADABLE) as error:
        if _is_replaced(path, timeline_id):
            raise TimelineError(f"the timeline at {path} was replaced by a new one.") from error
        if isinstance(error, DamagedError):
            raise
        raise DamagedError(path, f"{type(error).__name__}: {error}") from error


def _is_replaced(path: str, timeline_id: str) -> bool:
    try:
        return bool(_attributes(path)["id"] != timeline_id)
    except DamagedError:
        return False
    except TimelineError:
        return True


def _attributes(path: str) -> dict[str, Any]:
    try:
        attributes = read_group(path).attrs.asdict()
    except FileNotFoundError as error:
        raise TimelineError(f"no timeline at {path}: {error}") from error
    if not attributes:  # one that is just being created
        raise TimelineError(f"no timeline at {path} yet.")
    if attributes.get("format") not in (FORMAT, WINDOWS_FORMAT):
        raise TimelineError(
            f"got the format {attributes.get('format')!r} at {path}, expected {FORMAT!r} or "
            f"{WINDOWS_FORMAT!r}."
        )
    if missing := {"id", "chain", "frames", "status"} - attributes.keys():
        raise DamagedError(path, f"the timeline's attributes lack {', '.join(sorted(missing))}")
    return attributes
