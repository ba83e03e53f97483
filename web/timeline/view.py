"""Timeline view: a timeline decoded for display, shared by all viewers of a fold.

It caches recently requested frames in chunks, computes poses by forward kinematics on request, and
holds a summary of all frames for the progress bar below the 3D view. It follows a timeline that is
still growing, and one that is started anew. For a long fold, whose timeline holds windows
(``planner.motion.motion``), the chunks hold windows.
"""

from __future__ import annotations

import os
import secrets
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import Poses, forward_kinematics
from foldback.planner.errors import TimelineError
from foldback.planner.motion.motion import PHASES, Motion
from foldback.planner.motion.timeline import Timeline
from foldback.planner.storage.array_files import HEAD
from foldback.web.palette import error_scale, module_errors
from foldback.web.pictures.camera import modules_framed, straight_stretch
from foldback.web.pictures.table_top import TableTop
from foldback.web.timeline.cache import Cache

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

MAX_CHUNK_CACHE_BYTES: Final = 48 * 2**20
"""Maximum size of the cached frames of one motion, in bytes."""
REFRESH_INTERVAL_S: Final = 0.1
"""Minimum time between two checks of a running fold's motion for new frames, in s."""
TABLE_EXTENT_SAMPLES: Final = 256
"""Approximate number of frames, spread over a motion, from which the size of the displayed table is
computed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Snapshot:
    """State of a chain at one frame.

    Attributes:
        frame: Frame number; fractional between two recorded frames.
        time_s: Simulated time, s.
        phase: ``explosion`` or ``playback``.
        positions: (n, 3) centres of the modules in pitches.
        wxyzs: (n, 4) orientations of the modules, as quaternions.
        joint_angles_rad: (J,) hinge angles.
        joint_error_rad: (J,) hinge errors, NaN where none is recorded.
        module_error_rad: (n,) joint error that each module displays.
        framed: Number of modules, from the first on, that a camera shows.
    """

    frame: float
    time_s: float
    phase: str
    positions: Floats
    wxyzs: Floats
    joint_angles_rad: Array
    joint_error_rad: Array
    module_error_rad: Array
    framed: int


class TimelineView:
    """A timeline decoded for display. Thread-safe."""

    def __init__(self, path: str | Path) -> None:
        """Open the timeline at ``path``.

        Raises:
            TimelineError: If there is none yet, or it is damaged.
        """
        self.path = str(path)
        self._lock = threading.RLock()
        self._begin()

    def _begin(self) -> None:
        stamp = self._stamp_now()  # taken first, so that later writes are noticed
        self._timeline, self._stamp = Timeline.open(self.path), stamp
        self._chunks: Cache[Motion] = Cache(MAX_CHUNK_CACHE_BYTES, lambda motion: motion.nbytes)
        self._table: TableTop | None = None
        self._refreshed = time.monotonic()
        self._summarised = 0
        self._phase: NDArray[np.uint8] = np.zeros(0, np.uint8)
        self._time_s: Array = np.zeros(0)
        self._max_error: Array = np.zeros(0)
        self.stretch = straight_stretch(self.chain) if self.windowed else None
        """Number of straight modules that a camera keeps in view; all of them when None."""
        self._summarise()

    def __len__(self) -> int:
        return self._summarised

    @property
    def id(self) -> str:
        """Id of the timeline; one that replaces another at the same path has a different id."""
        return self._timeline.id

    @property
    def edition(self) -> tuple[object, ...]:
        """Key of derived data; it changes with every flush of the timeline's writer."""
        return (self.path, self.id, self._stamp, self._summarised)

    @property
    def nbytes(self) -> int:
        """Approximate memory of the view, bytes."""
        summary = self._phase.nbytes + self._time_s.nbytes + self._max_error.nbytes
        return 2**18 + summary + self._chunks.nbytes

    @property
    def chain(self) -> Chain:
        """Displayed chain."""
        return self._timeline.chain

    @property
    def windowed(self) -> bool:
        """True if the timeline holds windows."""
        return self._timeline.windowed

    @property
    def growing(self) -> bool:
        """True while frames are still being added."""
        return self._timeline.status == "growing"

    @property
    def status(self) -> str:
        """Status of the timeline: ``growing``, ``complete`` or ``failed``."""
        return self._timeline.status

    @property
    def error_scale_rad(self) -> float:
        """Joint error at which a module is fully red."""
        with self._lock:
            finite_errors = self._max_error[np.isfinite(self._max_error)]
            return error_scale(float(finite_errors.max()) if len(finite_errors) else 0.0)

    def refresh(self, *, at_once: bool = False) -> bool:
        """Read new frames, at most every ``REFRESH_INTERVAL_S``; return True after a change."""
        with self._lock:
            now = time.monotonic()
            if not at_once and now - self._refreshed < REFRESH_INTERVAL_S:
                return False
            self._refreshed = now
            stamp = self._stamp_now()
            if not self.growing and stamp == self._stamp:
                return False
            before = (self._summarised, self._timeline.status)
            try:
                self._timeline.refresh()
                self._stamp = stamp
                self._summarise()
            except (TimelineError, OSError, ValueError, KeyError):
                # The timeline is being replaced; keep this one until the new one can be read.
                try:
                    self._begin()
                except (TimelineError, OSError, ValueError, KeyError):
                    return False
            return before != (self._summarised, self._timeline.status)

    def snapshot(self, frame: float) -> Snapshot:
        """Return the snapshot at ``frame``, interpolated if it is not an integer.

        Raises:
            TimelineError: If the view holds no frame yet, or its timeline is being replaced.
        """
        with self._lock:
            if not self._summarised:
                raise TimelineError(f"{self.path} has no frames yet, expected at least one.")
            place = float(np.clip(frame, 0, self._summarised - 1))
            low = int(place)
            share = place - low
            if share < 1e-6 or low + 1 >= self._summarised:
                return self._exact(low)
            return self._between(low, share)

    def motion(self, start: int, stop: int, stride: int = 1) -> Motion:
        """Return frames as they were recorded, in the layout of the timeline.

        Raises:
            TimelineError: If there are no such frames, or the timeline is being replaced.
        """
        with self.reading():
            return self._timeline.motion(start, min(stop, self._summarised), stride)

    def table(self) -> TableTop:
        """Return the table that the chain folds on, large enough for the whole motion.

        Raises:
            TimelineError: If the timeline is being replaced.
        """
        with self._lock:
            if self.growing or not self._summarised:
                return TableTop.under(self.chain)
            if self._table is None:
                stride = max(1, self._summarised // TABLE_EXTENT_SAMPLES)
                poses = self.motion(0, self._summarised, stride).poses(self.chain)
                self._table = TableTop.under(self.chain, poses.positions)
            return self._table

    @contextmanager
    def reading(self) -> Generator[None]:
        """Ensure that all reads in the context see one state of one timeline.

        Raises:
            TimelineError: If the timeline was replaced during the reads; removed chunks would read
                as zeros.
        """
        with self._lock:
            try:
                yield
            except (OSError, ValueError, KeyError) as error:
                raise TimelineError(
                    f"{self.path} is being replaced; try again ({error})"
                ) from error
            if self._stamp_now() != self._stamp and self._timeline.replaced:
                raise TimelineError(f"{self.path} is being replaced; try again.")

    def outline(self, columns: int = 320) -> dict[str, Any]:
        """Return the progress bar's data: phases, and the largest error in each column."""
        with self._lock:
            total = self._summarised
            return {
                "frames": total,
                "growing": self.growing,
                "names": list(PHASES),
                "phases": self._phases(),
                "errors": self._columns(columns),
                "error_scale_rad": self.error_scale_rad,
                "end_s": float(self._time_s[-1]) if total else 0.0,
            }

    def _phases(self) -> list[dict[str, Any]]:
        changes = (np.flatnonzero(np.diff(self._phase)) + 1).tolist()
        return [
            {"name": PHASES[int(self._phase[start])], "from": start, "to": stop}
            for start, stop in pairwise([0, *changes, self._summarised])
            if start < stop
        ]

    def _columns(self, columns: int) -> list[float | None]:
        total = self._summarised
        count = min(columns, total)
        if not count:
            return []
        edges = np.linspace(0, total, count + 1).astype(int)[:-1]
        filled = np.where(np.isfinite(self._max_error), self._max_error, -1.0)
        return [
            None if value < 0 else float(f"{value:.3g}")
            for value in np.maximum.reduceat(filled, edges)
        ]

    def _stamp_now(self) -> tuple[int, int] | None:
        """Return (inode, mtime) of the timeline's metadata; it changes with every flush."""
        try:
            stat = os.stat(os.path.join(self.path, HEAD))
        except OSError:
            return None
        return (stat.st_ino, stat.st_mtime_ns)

    def _summarise(self) -> None:
        start, stop = self._summarised, len(self._timeline)
        if stop <= start:
            return
        time_s, phase = self._timeline.clock(start)
        largest = self._timeline.largest_errors(start)
        self._phase = np.concatenate([self._phase, phase])
        self._time_s = np.concatenate([self._time_s, time_s])
        self._max_error = np.concatenate([self._max_error, largest])
        self._summarised = stop

    def _exact(self, frame: int) -> Snapshot:
        motion, k = self._recorded(frame)
        return moment_of(self.chain, motion, k, frame=frame, stretch=self.stretch)

    def _between(self, low: int, share: float) -> Snapshot:
        a, b = self._exact(low), self._exact(low + 1)
        (first, j), (second, k) = self._recorded(low), self._recorded(low + 1)
        angles = _mix(a.joint_angles_rad, b.joint_angles_rad, share)
        position = _mix(first.anchor_position[j], second.anchor_position[k], share)
        start, end = first.anchor_wxyz[j], second.anchor_wxyz[k]
        turn = _mix(start, end * (1.0 if start @ end >= 0 else -1.0), share)
        turn = turn / np.linalg.norm(turn)
        poses = _poses(self.chain, angles, position, turn, windowed=self.windowed)
        return replace(
            a,
            frame=low + share,
            time_s=a.time_s + (b.time_s - a.time_s) * share,
            positions=poses.positions.astype(np.float32),
            wxyzs=poses.wxyzs.astype(np.float32),
            joint_angles_rad=angles,
            framed=max(a.framed, b.framed),
        )

    def _recorded(self, frame: int) -> tuple[Motion, int]:
        """Return the cached chunk that holds a frame, and the frame's index in it."""
        rows = 512 if self.windowed else 64
        start = frame - frame % rows
        stop = min(start + rows, self._summarised)  # the last chunk may still grow
        motion = self._chunks.get_or_make((start, stop), lambda: self.motion(start, stop))
        return motion, frame - start


def _mix(a: Array, b: Array, share: float) -> Array:
    return a + (b - a) * share


def moment_of(chain: Chain, motion: Motion, k: int, *, frame: int, stretch: int | None) -> Snapshot:
    """Return the snapshot of a recorded frame.

    Args:
        chain: The chain.
        motion: Motion of the chain, or a part of it.
        k: Index of the frame in ``motion``.
        frame: Number of the frame in the whole motion.
        stretch: Number of straight modules that a camera keeps in view; all of them when None.
    """
    angles = motion.angles(chain, k, k + 1)[0]
    errors = motion.joint_errors(chain, k, k + 1)[0]
    position, wxyz = motion.anchor_position[k], motion.anchor_wxyz[k]
    poses = _poses(chain, angles, position, wxyz, windowed=motion.is_windowed)
    framed = len(chain)
    if stretch is not None:
        framed = modules_framed(chain, int(motion.last[k]), stretch)
    return Snapshot(
        frame=float(frame),
        time_s=float(motion.time_s[k]),
        phase=PHASES[int(motion.phase[k])],
        positions=poses.positions.astype(np.float32),
        wxyzs=poses.wxyzs.astype(np.float32),
        joint_angles_rad=angles,
        joint_error_rad=errors,
        module_error_rad=module_errors(errors, chain.module, len(chain)),
        framed=framed,
    )


def _poses(chain: Chain, angles: Array, position: Array, wxyz: Array, *, windowed: bool) -> Poses:
    """Return the poses for (J,) angles and the recorded pose of one module."""
    root = 0 if windowed else chain.root
    return forward_kinematics(
        chain.module, angles, root=root, root_position=position, root_wxyz=wxyz
    )


class MotionMoments:
    """Motion in memory: poses by forward kinematics, computed on request."""

    growing = False

    def __init__(self, chain: Chain, motion: Motion, motion_id: str | None = None) -> None:
        """Store a motion and the id of the timeline that it was read from, if any."""
        self.id = motion_id or secrets.token_hex(8)
        self.chain = chain
        self._motion = motion
        self.stretch = straight_stretch(chain) if motion.is_windowed else None
        largest_errors = motion.largest_errors
        self.error_scale_rad = error_scale(
            float(np.max(largest_errors, where=largest_errors > 0.0, initial=0.0))
        )

    def __len__(self) -> int:
        return len(self._motion)

    def table(self) -> TableTop:
        """Return the table that the chain folds on, large enough for the whole motion."""
        sample = self._motion[:: max(1, len(self) // TABLE_EXTENT_SAMPLES)]
        return TableTop.under(self.chain, sample.poses(self.chain).positions)

    def snapshot(self, frame: float) -> Snapshot:
        """Return the snapshot of the recorded frame nearest to ``frame``."""
        k = min(max(round(frame), 0), len(self) - 1)
        return moment_of(self.chain, self._motion, k, frame=k, stretch=self.stretch)


MotionSource = TimelineView | MotionMoments
"""Motion that viewers can show."""
