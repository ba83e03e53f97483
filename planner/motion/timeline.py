"""Timeline: time-ordered snapshots of one fold, append-only while it runs, tail-readable.

It is the only thing that passes from the computing side to the showing side. On disk it is a zarr
group. Frames become visible to readers when the group's ``frames`` attribute has grown, which is
written last; a reader never sees half a frame.

There are two layouts, told apart by their format: one holds all angles of each frame, the other
only those of its window (``planner.motion.windows``). Either is read as the one or the other.
"""

from __future__ import annotations

import secrets
import time
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, Final, Literal, cast

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.module import module_named
from planner.errors import UNREADABLE, InputError, TimelineError
from planner.files import zarr_group
from planner.motion.frames import Frames
from planner.motion.motion import Motion, joined
from planner.motion.windows import Windows

if TYPE_CHECKING:
    import zarr

Array = NDArray[np.float64]
FORMAT: Final = "foldback-timeline/1"
WINDOWS_FORMAT: Final = "foldback-timeline/2"
Status = Literal["growing", "complete", "failed"]
FRAMES_A_CHUNK: Final = 128
"""Frames in a chunk of every array."""
WINDOWS_A_CHUNK: Final = 4096
ANGLES_A_CHUNK: Final = 2**16
FLUSH_EVERY_S: Final = 0.15
"""Seconds between two flushes, at least."""
FLUSH_SHARE: Final = 0.1
"""Share of a writer's time for flushes; one costs about the same however much it writes."""
FLUSH_EVERY_S_AT_MOST: Final = 1.0
"""Seconds between two flushes, at most."""


def _frame_columns(joints: int) -> dict[str, tuple[tuple[int, ...], str, int]]:
    """Of frames: the shape behind the first axis, the type, and the rows of a chunk."""
    return {
        "time_s": ((), "float64", FRAMES_A_CHUNK),
        "phase": ((), "uint8", FRAMES_A_CHUNK),
        "joint_angles_rad": ((joints,), "float64", FRAMES_A_CHUNK),
        "root_position": ((3,), "float64", FRAMES_A_CHUNK),
        "root_wxyz": ((4,), "float64", FRAMES_A_CHUNK),
        "joint_error_rad": ((joints,), "float32", FRAMES_A_CHUNK),
    }


def _window_columns() -> dict[str, tuple[tuple[int, ...], str, int]]:
    """Of windows; ``ends`` says where those of each frame end in ``angles_rad``."""
    return {
        "time_s": ((), "float64", WINDOWS_A_CHUNK),
        "phase": ((), "uint8", WINDOWS_A_CHUNK),
        "first": ((), "int64", WINDOWS_A_CHUNK),
        "ends": ((), "int64", WINDOWS_A_CHUNK),
        "base_position": ((3,), "float64", WINDOWS_A_CHUNK),
        "base_wxyz": ((4,), "float64", WINDOWS_A_CHUNK),
        "angles_rad": ((), "float32", ANGLES_A_CHUNK),
        "errors_rad": ((), "float32", ANGLES_A_CHUNK),
    }


def chain_attributes(chain: Chain) -> dict[str, Any]:
    """What a timeline or plan says of its chain, as plain JSON values."""
    return {
        "name": chain.name,
        "module": chain.module.name,
        "modules": len(chain),
        "pitch_m": chain.pitch_m,
        "root": chain.root,
        "joint_names": list(chain.joint_names),
        "folded_rad": chain.folded_rad.tolist(),
        "folded_position": chain.folded_position.tolist(),
        "folded_wxyz": chain.folded_wxyz.tolist(),
    }


def chain_from_attributes(attributes: dict[str, Any]) -> Chain:
    """The chain described by ``chain_attributes``."""
    return Chain(
        name=str(attributes["name"]),
        module=module_named(attributes["module"]),
        folded_rad=np.asarray(attributes["folded_rad"], dtype=np.float64),
        folded_position=np.asarray(attributes["folded_position"], dtype=np.float64),
        folded_wxyz=np.asarray(attributes["folded_wxyz"], dtype=np.float64),
        pitch_m=float(attributes["pitch_m"]),
    )


class TimelineWriter:
    """Appends frames to a timeline. One writer at a time; a context manager."""

    def __init__(self, group: zarr.Group, chain: Chain, frames: int, *, windowed: bool) -> None:
        self._group = group
        self._chain = chain
        self._frames = frames
        self._windowed = windowed
        self._waiting: list[Motion] = []
        self._arrays: dict[str, zarr.Array[Any]] = {}
        self._next_flush = time.monotonic() + FLUSH_EVERY_S
        self._status: Status = "growing"

    @classmethod
    def create(
        cls, path: str | FilePath, chain: Chain, *, windowed: bool = False
    ) -> TimelineWriter:
        """A new, empty timeline; what was at ``path`` is replaced.

        Args:
            path: Where it shall be.
            chain: Whose frames it holds.
            windowed: Whether it takes ``Windows``; else it takes ``Frames``.
        """
        # First of all: who has read frames while their files were deleted sees that by its absence.
        (FilePath(path) / "zarr.json").unlink(missing_ok=True)
        group = zarr_group(path, "w")
        from zarr.codecs import BloscCodec  # late: ``zarr_group`` has loaded it

        codec = BloscCodec(cname="zstd", clevel=3, shuffle="shuffle")
        columns = _window_columns() if windowed else _frame_columns(len(chain.folded_rad))
        for name, (tail, dtype, rows) in columns.items():
            group.create_array(
                name,
                shape=(0, *tail),
                chunks=(rows, *tail),
                dtype=dtype,
                compressors=[codec],
                fill_value=np.nan if name == "errors_rad" else 0,
            )
        told = chain_attributes(chain)
        if windowed:
            # The attributes are written and read over and over: what is long is beside them.
            group.create_array("folded_rad", data=chain.folded_rad)
            told = {k: v for k, v in told.items() if k not in ("folded_rad", "joint_names")}
        group.attrs.put(
            {
                "format": WINDOWS_FORMAT if windowed else FORMAT,
                # Tells a timeline that was begun anew from the one that was there before.
                "id": secrets.token_hex(8),
                "chain": told,
                "frames": 0,
                "status": "growing",
            }
        )
        return cls(group, chain, 0, windowed=windowed)

    @classmethod
    def reopen(cls, path: str | FilePath, *, frames: int | None = None) -> TimelineWriter:
        """Goes on with a timeline after its first ``frames`` frames (all of them when None)."""
        timeline = Timeline.open(path)
        kept = len(timeline) if frames is None else frames
        if not 0 <= kept <= len(timeline):
            raise TimelineError(
                f"got {kept} frames to keep, expected 0 to {len(timeline)}, which {path} holds."
            )
        group = zarr_group(path, "r+")
        if kept < len(timeline):
            # Who has read what is dropped has to begin anew.
            group.attrs.update({"id": secrets.token_hex(8)})
        writer = cls(group, timeline.chain, kept, windowed=timeline.windowed)
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
        """Adds frames; they reach the disk within ``FLUSH_EVERY_S_AT_MOST`` of further calls.

        Raises:
            TimelineError: When they are not of the kind or of the chain that it is for.
        """
        if self._status != "growing":
            raise TimelineError(f"the timeline is {self._status}; only a growing one takes frames.")
        if isinstance(frames, Windows) != self._windowed:
            expected = "Windows" if self._windowed else "Frames"
            raise TimelineError(f"got {type(frames).__name__}, expected {expected}.")
        hinges = len(self._chain.folded_rad)
        if isinstance(frames, Frames):
            joints = frames.joint_angles_rad.shape[-1]
            if joints != hinges:
                raise TimelineError(
                    f"got frames of {joints} joint angles, expected {hinges}, as the timeline's "
                    "chain has."
                )
        elif len(frames) and int(frames.last.max()) > hinges:
            raise TimelineError(
                f"got windows up to hinge {int(frames.last.max())}, expected {hinges} at most, as "
                "the timeline's chain has."
            )
        if len(frames):
            self._waiting.append(frames)
        if time.monotonic() >= self._next_flush:
            self.flush()

    def flush(self) -> None:
        """Writes what waits and makes it visible to readers."""
        begun = time.monotonic()
        self._next_flush = begun + FLUSH_EVERY_S
        if not self._waiting:
            return
        motion = joined(self._waiting)
        self._waiting = []
        stop = self._frames + len(motion)
        if isinstance(motion, Windows):
            begins = int(cast("Any", self._array("ends")[self._frames - 1])) if self._frames else 0
            values = {
                **{name: getattr(motion, name) for name in _WINDOW_ROWS},
                "ends": begins + motion.offsets[1:],
            }
            for name in ("angles_rad", "errors_rad"):
                flat = getattr(motion, name)
                if name in self._group:  # earlier timelines have no errors
                    array = self._array(name)
                    array.resize((begins + len(motion.angles_rad),))
                    if flat is not None:  # what is not written takes no room and is read as NaN
                        array[begins:] = flat
        else:
            values = {name: getattr(motion, name) for name in _frame_columns(0)}
        for name, column in values.items():
            array = self._array(name)
            array.resize((stop, *array.shape[1:]))
            array[self._frames : stop] = column.astype(array.dtype)
        self._frames = stop
        self._mark("growing")
        now = time.monotonic()
        pause = min((now - begun) / FLUSH_SHARE, FLUSH_EVERY_S_AT_MOST)
        self._next_flush = now + max(pause, FLUSH_EVERY_S)

    def _array(self, name: str) -> zarr.Array[Any]:
        if name not in self._arrays:
            self._arrays[name] = cast("zarr.Array[Any]", self._group[name])
        return self._arrays[name]

    def close(self, status: Status = "complete") -> None:
        """Writes what waits and closes the timeline for good."""
        self.flush()
        self._mark(status)

    def _mark(self, status: Status) -> None:
        self._status = status
        self._group.attrs.update({"frames": self._frames, "status": status})


_WINDOW_ANGLES: Final = ("angles_rad", "errors_rad")
_WINDOW_ROWS: Final = ("time_s", "phase", "first", "base_position", "base_wxyz")


class Timeline:
    """Reads a timeline, at its tail too while it grows."""

    def __init__(self, path: str, attributes: dict[str, Any]) -> None:
        self.path = path
        self.id = str(attributes["id"])
        self.windowed = attributes["format"] == WINDOWS_FORMAT
        self._arrays: dict[str, zarr.Array[Any]] = {}
        self._frames = 0
        self._status: Status = "growing"
        told = attributes["chain"]
        if self.windowed:
            try:
                folded = cast("zarr.Array[Any]", zarr_group(path)["folded_rad"])
            except KeyError as error:
                raise TimelineError(f"{path} is damaged: it lacks {error}.") from error
            told = {**told, "folded_rad": np.asarray(folded[:]).tolist()}
        self.told_chain = dict(told)
        self.chain = chain_from_attributes(told)
        self._take(attributes)

    @classmethod
    def open(cls, path: str | FilePath) -> Timeline:
        """Opens a timeline.

        Raises:
            TimelineError: When there is none, or it is damaged.
        """
        attributes = _attributes(str(path))
        try:
            return cls(str(path), attributes)
        except (*UNREADABLE, InputError) as error:
            raise TimelineError(f"{path} is damaged: {error}") from error

    def __len__(self) -> int:
        """Frames seen at the last ``refresh``."""
        return self._frames

    @property
    def status(self) -> Status:
        """``growing``, ``complete`` or ``failed``, as of the last ``refresh``."""
        return self._status

    def refresh(self) -> bool:
        """Looks for new frames; True when anything has changed.

        Raises:
            TimelineError: When another one has taken its place, or is about to.
        """
        before = (self._frames, self._status)
        attributes = _attributes(self.path)
        if attributes["id"] != self.id:
            raise TimelineError(f"the timeline at {self.path} has been begun anew.")
        self._take(attributes)
        return before != (self._frames, self._status)

    @property
    def replaced(self) -> bool:
        """Whether another one has taken its place, or is about to."""
        try:
            return bool(_attributes(self.path)["id"] != self.id)
        except TimelineError:
            return True

    def motion(self, start: int = 0, stop: int | None = None, stride: int = 1) -> Motion:
        """As ``frames``, in the layout that the timeline has."""
        return (self.windows if self.windowed else self.frames)(start, stop, stride)

    def frames(self, start: int = 0, stop: int | None = None, stride: int = 1) -> Frames:
        """Frames ``start`` to ``stop`` (all there are when None), every ``stride``-th one.

        Raises:
            TimelineError: When the range is not within the timeline.
        """
        if self.windowed:
            return self.windows(start, stop, stride).dense(self.chain)
        end = self._end(start, stop, stride)
        found: dict[str, Any] = {}
        for name in _frame_columns(0):
            part = _strided(self._arrays[name], start, end, stride)
            found[name] = part.astype(np.float64) if part.dtype == np.float32 else part
        return Frames(**found)

    def windows(self, start: int = 0, stop: int | None = None, stride: int = 1) -> Windows:
        """As ``frames``, with only the angles of each frame's window.

        Raises:
            TimelineError: When the range is not within the timeline.
        """
        if not self.windowed:
            return Windows.of(self.chain, self.frames(start, stop, stride))
        end = self._end(start, stop, stride)
        numbers = np.arange(start, end, stride)
        ends = cast("NDArray[np.int64]", self._arrays["ends"][max(start - 1, 0) : end])
        ends = np.concatenate([[0], ends]) if start == 0 else ends
        begins, stops = ends[numbers - start], ends[numbers - start + 1]
        flat: dict[str, NDArray[np.float32]] = {}
        for name in _WINDOW_ANGLES:
            array = cast("Any", self._arrays.get(name))
            if array is None:
                continue
            if stride == 1 or not len(numbers):
                flat[name] = array[int(ends[0]) : int(ends[-1])]
            else:
                parts = zip(begins.tolist(), stops.tolist(), strict=True)
                flat[name] = np.concatenate([array[a:b] for a, b in parts])
        errors = flat.get("errors_rad")
        return Windows(
            offsets=np.concatenate([[0], np.cumsum(stops - begins)]),
            angles_rad=flat["angles_rad"],
            errors_rad=None if errors is None or np.isnan(errors).all() else errors,
            **{name: cast("Any", self._arrays[name][start:end])[::stride] for name in _WINDOW_ROWS},
        )

    @property
    def tells_errors(self) -> bool:
        """Whether joint errors of any frame may be recorded; those of windows are not read."""
        array = cast("Any", self._arrays.get("errors_rad"))
        return not self.windowed or (array is not None and array.nchunks_initialized > 0)

    def window_errors(self, start: int = 0, stop: int | None = None) -> Array:
        """(f,) the largest joint error of each window, NaN where none is recorded.

        Where none is at all, nothing is read.

        Raises:
            TimelineError: When the range is not within the timeline.
        """
        end, rows = self._end(start, stop, 1), WINDOWS_A_CHUNK
        if not self.tells_errors:
            return np.full(end - start, np.nan)
        parts = [
            self.windows(at, min(at + rows, end)).largest_errors for at in range(start, end, rows)
        ]
        return np.concatenate([np.zeros(0), *parts])

    def clock(self) -> tuple[Array, NDArray[np.uint8]]:
        """(F,) times and (F,) phases of all frames, without reading the rest of them."""
        time_s, phase = (self._arrays[name][: self._frames] for name in ("time_s", "phase"))
        return cast("Array", time_s), cast("NDArray[np.uint8]", phase)

    def _end(self, start: int, stop: int | None, stride: int) -> int:
        end = self._frames if stop is None else stop
        if not (0 <= start <= end <= self._frames and stride >= 1):
            raise TimelineError(
                f"got frames {start} to {end} by {stride}, expected a range within the "
                f"{self._frames} frames there are."
            )
        return end

    def _take(self, attributes: dict[str, Any]) -> None:
        frames = int(attributes["frames"])
        if frames != self._frames or not self._arrays:
            group = zarr_group(self.path)
            columns = _window_columns() if self.windowed else _frame_columns(0)
            try:
                self._arrays = {
                    n: cast("zarr.Array[Any]", group[n])
                    for n in columns
                    if n != "errors_rad" or n in group  # earlier timelines have none
                }
            except KeyError as error:
                raise TimelineError(f"{self.path} is damaged: it lacks {error}.") from error
            rows = [a.shape[0] for n, a in self._arrays.items() if n not in _WINDOW_ANGLES]
            if not 0 <= frames <= min(rows):
                raise TimelineError(
                    f"{self.path} is damaged: it promises {frames} frames and holds {min(rows)}."
                )
        self._frames = frames
        self._status = cast("Status", attributes["status"])


def _strided(array: zarr.Array[Any], start: int, end: int, stride: int) -> NDArray[Any]:
    """``array[start:end:stride]``; of a chunk at a time where there is a stride, if it has any."""
    if stride == 1:
        return cast("NDArray[Any]", array[start:end])
    wanted = np.arange(start, end, stride)
    edges = np.flatnonzero(np.diff(wanted // array.chunks[0])) + 1
    parts = [
        cast("NDArray[Any]", array[int(part[0]) : int(part[-1]) + 1])[::stride]
        for part in np.split(wanted, edges)
        if len(part)
    ]
    return np.concatenate(parts) if parts else cast("NDArray[Any]", array[start:start])


def _attributes(path: str) -> dict[str, Any]:
    try:
        attributes = zarr_group(path).attrs.asdict()
    except (OSError, ValueError, KeyError) as error:
        raise TimelineError(f"no timeline at {path}: {error}") from error
    if attributes.get("format") not in (FORMAT, WINDOWS_FORMAT):
        raise TimelineError(
            f"got the format {attributes.get('format')!r} at {path}, expected {FORMAT!r} or "
            f"{WINDOWS_FORMAT!r}."
        )
    try:
        found = {key: attributes[key] for key in ("format", "chain", "frames", "status")}
    except KeyError as error:
        raise TimelineError(f"{path} is damaged: it lacks {error}.") from error
    return {**found, "id": attributes.get("id", "")}
