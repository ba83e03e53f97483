"""Timeline: time-ordered snapshots of one fold, append-only while it runs, tail-readable.

It is the only thing that passes from the computing side to the showing side. On disk it is a zarr
group. Frames become visible to readers when the group's ``frames`` attribute has grown, which is
written last; a reader never sees half a frame.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path as FilePath
from typing import Any, Final, Literal, cast

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.codecs import BloscCodec

from planner.chain import Chain
from planner.errors import TimelineError
from planner.modules import module_named

Array = NDArray[np.float64]
FORMAT: Final = "foldback-timeline/1"
PHASES: Final = ("explosion", "playback", "unfolding")
Phase = Literal["explosion", "playback", "unfolding"]
Status = Literal["growing", "complete", "failed"]
FRAMES_A_CHUNK: Final = 128
FLUSH_EVERY_S: Final = 0.15


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frames:
    """F snapshots in the order of time.

    Attributes:
        time_s: (F,) simulated time, rising through all phases.
        phase: (F,) uint8 index into ``PHASES``.
        joint_angles_rad: (F, J).
        root_position: (F, 3) centre of the root module in pitches.
        root_wxyz: (F, 4) its orientation.
        joint_error_rad: (F, J) distance of each hinge from its reference; NaN where there is none.
    """

    time_s: Array
    phase: NDArray[np.uint8]
    joint_angles_rad: Array
    root_position: Array
    root_wxyz: Array
    joint_error_rad: Array

    def __len__(self) -> int:
        return len(self.time_s)

    def __getitem__(self, index: slice | NDArray[np.integer[Any]]) -> Frames:
        return Frames(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    @classmethod
    def of_phase(
        cls,
        phase: Phase,
        *,
        time_s: Array,
        joint_angles_rad: Array,
        root_position: Array,
        root_wxyz: Array,
        joint_error_rad: Array | None = None,
    ) -> Frames:
        """Frames that all belong to one phase; no error recorded when it is None."""
        if joint_error_rad is None:
            joint_error_rad = np.full_like(joint_angles_rad, np.nan)
        return cls(
            time_s=time_s,
            phase=np.full(len(time_s), PHASES.index(phase), dtype=np.uint8),
            joint_angles_rad=joint_angles_rad,
            root_position=root_position,
            root_wxyz=root_wxyz,
            joint_error_rad=joint_error_rad,
        )

    @classmethod
    def joined(cls, parts: Sequence[Frames]) -> Frames:
        """One after the other."""
        return cls(
            **{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)}
        )


def _columns(joints: int) -> dict[str, tuple[tuple[int, ...], str]]:
    return {
        "time_s": ((), "float64"),
        "phase": ((), "uint8"),
        "joint_angles_rad": ((joints,), "float64"),
        "root_position": ((3,), "float64"),
        "root_wxyz": ((4,), "float64"),
        "joint_error_rad": ((joints,), "float32"),
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

    def __init__(self, group: zarr.Group, chain: Chain, frames: int) -> None:
        self._group = group
        self._chain = chain
        self._frames = frames
        self._waiting: list[Frames] = []
        self._last_flush = time.monotonic()
        self._status: Status = "growing"

    @classmethod
    def create(cls, path: str | FilePath, chain: Chain) -> TimelineWriter:
        """A new, empty timeline; what was at ``path`` is replaced."""
        group = zarr.open_group(str(path), mode="w", zarr_format=3)
        codec = BloscCodec(cname="zstd", clevel=3, shuffle="shuffle")
        for name, (tail, dtype) in _columns(len(chain.folded_rad)).items():
            group.create_array(
                name,
                shape=(0, *tail),
                chunks=(FRAMES_A_CHUNK, *tail),
                dtype=dtype,
                compressors=[codec],
            )
        group.attrs.put(
            {
                "format": FORMAT,
                # Tells a timeline that was begun anew from the one that was there before.
                "id": secrets.token_hex(8),
                "chain": chain_attributes(chain),
                "frames": 0,
                "status": "growing",
            }
        )
        return cls(group, chain, 0)

    @classmethod
    def reopen(cls, path: str | FilePath, *, frames: int | None = None) -> TimelineWriter:
        """Goes on with a timeline after its first ``frames`` frames (all of them when None)."""
        timeline = Timeline.open(path)
        kept = len(timeline) if frames is None else frames
        if not 0 <= kept <= len(timeline):
            raise TimelineError(
                f"got {kept} frames to keep, expected 0 to {len(timeline)}, which {path} holds."
            )
        group = zarr.open_group(str(path), mode="r+")
        if kept < len(timeline):
            # Who has read what is dropped has to begin anew.
            group.attrs.update({"id": secrets.token_hex(8)})
        writer = cls(group, timeline.chain, kept)
        writer._mark("growing")
        return writer

    def __enter__(self) -> TimelineWriter:
        return self

    def __exit__(self, kind: object, value: object, trace: object) -> None:
        if self._status == "growing":
            self.close("failed" if kind else "complete")

    def __len__(self) -> int:
        return self._frames + sum(len(w) for w in self._waiting)

    def append(self, frames: Frames) -> None:
        """Adds frames; they reach the disk within ``FLUSH_EVERY_S`` of further calls."""
        if self._status != "growing":
            raise TimelineError(f"the timeline is {self._status}; only a growing one takes frames.")
        joints = frames.joint_angles_rad.shape[-1]
        if joints != len(self._chain.folded_rad):
            raise TimelineError(
                f"got frames of {joints} joint angles, expected {len(self._chain.folded_rad)}, as "
                "the timeline's chain has."
            )
        if len(frames):
            self._waiting.append(frames)
        if time.monotonic() - self._last_flush >= FLUSH_EVERY_S:
            self.flush()

    def flush(self) -> None:
        """Writes what waits and makes it visible to readers."""
        self._last_flush = time.monotonic()
        if not self._waiting:
            return
        frames = Frames.joined(self._waiting)
        self._waiting = []
        start, stop = self._frames, self._frames + len(frames)
        for name in _columns(0):
            array = cast("zarr.Array[Any]", self._group[name])
            values = getattr(frames, name)
            array.resize((stop, *array.shape[1:]))
            array[start:stop] = values.astype(array.dtype)
        self._frames = stop
        self._mark("growing")

    def close(self, status: Status = "complete") -> None:
        """Writes what waits and closes the timeline for good."""
        self.flush()
        self._mark(status)

    def _mark(self, status: Status) -> None:
        self._status = status
        self._group.attrs.update({"frames": self._frames, "status": status})


class Timeline:
    """Reads a timeline, at its tail too while it grows."""

    def __init__(self, path: str, attributes: dict[str, Any]) -> None:
        self.path = path
        self.id = str(attributes["id"])
        self.chain = chain_from_attributes(attributes["chain"])
        self._arrays: dict[str, zarr.Array[Any]] = {}
        self._frames = 0
        self._status: Status = "growing"
        self._take(attributes)

    @classmethod
    def open(cls, path: str | FilePath) -> Timeline:
        """Opens a timeline.

        Raises:
            TimelineError: When there is none, or it is damaged.
        """
        return cls(str(path), _attributes(str(path)))

    def __len__(self) -> int:
        """Frames seen at the last ``refresh``."""
        return self._frames

    @property
    def status(self) -> Status:
        """``growing``, ``complete`` or ``failed``, as of the last ``refresh``."""
        return self._status

    def refresh(self) -> bool:
        """Looks for new frames; True when anything has changed."""
        before = (self._frames, self._status)
        self._take(_attributes(self.path))
        return before != (self._frames, self._status)

    def frames(self, start: int = 0, stop: int | None = None, stride: int = 1) -> Frames:
        """Frames ``start`` to ``stop`` (all there are when None), every ``stride``-th one.

        Raises:
            TimelineError: When the range is not within the timeline.
        """
        end = self._frames if stop is None else stop
        if not (0 <= start <= end <= self._frames and stride >= 1):
            raise TimelineError(
                f"got frames {start} to {end} by {stride}, expected a range within the "
                f"{self._frames} frames there are."
            )
        found: dict[str, Any] = {}
        for name in _columns(0):
            part = _strided(self._arrays[name], start, end, stride)
            found[name] = part.astype(np.float64) if part.dtype == np.float32 else part
        return Frames(**found)

    def clock(self) -> tuple[Array, NDArray[np.uint8]]:
        """(F,) times and (F,) phases of all frames, without reading the rest of them."""
        time_s, phase = (self._arrays[name][: self._frames] for name in ("time_s", "phase"))
        return cast("Array", time_s), cast("NDArray[np.uint8]", phase)

    def _take(self, attributes: dict[str, Any]) -> None:
        frames = int(attributes["frames"])
        if frames != self._frames or not self._arrays:
            group = zarr.open_group(self.path, mode="r")
            try:
                self._arrays = {n: cast("zarr.Array[Any]", group[n]) for n in _columns(0)}
            except KeyError as error:
                raise TimelineError(f"{self.path} is damaged: it lacks {error}.") from error
            short = min(array.shape[0] for array in self._arrays.values())
            if short < frames:
                raise TimelineError(
                    f"{self.path} is damaged: it promises {frames} frames and holds {short}."
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
        attributes = zarr.open_group(path, mode="r").attrs.asdict()
    except (OSError, ValueError, KeyError) as error:
        raise TimelineError(f"no timeline at {path}: {error}") from error
    if attributes.get("format") != FORMAT:
        raise TimelineError(
            f"got the format {attributes.get('format')!r} at {path}, expected {FORMAT!r}."
        )
    try:
        found = {key: attributes[key] for key in ("chain", "frames", "status")}
    except KeyError as error:
        raise TimelineError(f"{path} is damaged: it lacks {error}.") from error
    return {**found, "id": attributes.get("id", "")}


__all__ = ["FORMAT", "PHASES", "Frames", "Phase", "Timeline", "TimelineWriter"]
