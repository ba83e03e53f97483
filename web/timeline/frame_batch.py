"""Frame batch: a range of frames as one message, for a browser that computes the poses.

The header of a message (``web.timeline.columns``) holds the timeline's ``id``, its ``status``
(``growing``, ``complete`` or ``failed``), its number of frames (``total``), the ``start``, ``stop``
and ``stride`` of the frames in the columns, and the timeline's outline. The columns are those of a
dense motion: the time is exact, joint angles are within half a millionth of a radian and joint
errors within half a per cent, which keeps messages small. A windowed timeline has the columns of
``web.timeline.window_columns``.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.motion.motion import Motion
from foldback.planner.motion.timeline import TimelineWriter
from foldback.web.timeline.cache import Cache
from foldback.web.timeline.columns import encode
from foldback.web.timeline.view import TimelineView
from foldback.web.timeline.window_columns import (
    PLANE_COLUMNS,
    SENT_ANGLE_STEP_RAD,
    SHORT_COLUMNS,
    window_columns,
)

UNLIMITED_BYTES: Final = 2**40
"""Limit for the size of a batch of frames that is to hold a whole motion, in bytes: larger than any
motion."""
WINDOW_HEADER_BYTES: Final = 80
"""Number of bytes of one frame of a long chain besides the angles and errors of its moving section,
the only ones that such a frame stores. A batch of frames ends when their estimated size reaches its
limit; a larger value makes the estimate larger."""
WINDOWS_PER_READ: Final = 512
"""Number of frames of a long chain that are read at once until a batch is full; each frame stores
only the section that moves, so their sizes are not known in advance."""
_BATCHES: Final[Cache[bytes]] = Cache(64 * 2**20, len)


def cached_batch(
    timeline: TimelineView, start: int = 0, stop: int | None = None, stride: int = 1
) -> bytes:
    """Return a batch of the default size; recent batches of finished timelines are cached.

    Raises:
        TimelineError: If the timeline is being replaced.
    """
    with timeline.reading():
        key = (timeline.edition, start, stop, stride)
        if (data := _BATCHES.get(key)) is not None:
            return data
        data = batch_of(timeline, start, stop, stride)
        if timeline.growing:
            return data
    _BATCHES.keep(key, data)
    return data


def batch_of(
    timeline: TimelineView,
    start: int = 0,
    stop: int | None = None,
    stride: int = 1,
    *,
    largest: int = 2**20,
    without: frozenset[str] = frozenset(),
) -> bytes:
    """Return as many frames from ``start`` on as fit into one message.

    Args:
        timeline: Timeline of the frames.
        start: First frame; if it is past the end, the batch has no frames.
        stop: End of the frames, exclusive; the timeline's end when None.
        stride: Step between frames.
        largest: Approximate maximum size of the angles and errors when unpacked, bytes.
        without: Columns to leave out.

    Raises:
        TimelineError: If the timeline is being replaced.
    """
    with timeline.reading():  # so that header and columns agree
        total = len(timeline)
        start = min(start, total)
        end = total if stop is None else max(start, min(stop, total))
        if timeline.windowed:
            windows, end = _windows(timeline, start, end, stride, largest)
            columns = window_columns(windows, timeline.chain.folded_rad)
        else:
            max_frames = max(1, largest // (8 * len(timeline.chain.joint_names) + 40))
            end = min(end, start + max_frames * stride)
            columns = _dense_columns(timeline.motion(start, end, stride))
        header = {
            "id": timeline.id,
            "status": timeline.status,
            "total": total,
            "start": start,
            "stop": end,
            "stride": stride,
            "outline": timeline.outline(),
        }
        return encode(
            header,
            {name: values for name, values in columns.items() if name not in without},
            steps={"joint_angles_rad": SENT_ANGLE_STEP_RAD},
            planes=PLANE_COLUMNS,
            short=SHORT_COLUMNS,
        )


def _dense_columns(frames: Motion) -> dict[str, NDArray[Any]]:
    return {
        "time_s": frames.time_s.astype("<f8"),
        "phase": frames.phase.astype("|u1"),
        "root_position": frames.root_position.astype("<f4"),
        "root_wxyz": frames.root_wxyz.astype("<f4"),
        "joint_angles_rad": frames.joint_angles_rad.astype("<f4"),
        "joint_error_rad": frames.joint_error_rad.astype("<f4"),
    }


def unpacked_bytes(timeline: TimelineView) -> int:
    """Return the approximate size of an uncompressed batch of the whole timeline, in bytes."""
    if not timeline.windowed:
        return len(timeline) * (8 * len(timeline.chain.joint_names) + 40)
    sample = timeline.motion(0, len(timeline), max(1, len(timeline) // 64))
    return len(timeline) * (
        WINDOW_HEADER_BYTES + _hinge(sample) * len(sample.angles_rad) // max(1, len(sample))
    )


def _hinge(windows: Motion) -> int:
    """Return the bytes of one angle, with its error if errors are recorded."""
    return 4 if windows.errors_rad is None else 8


def _windows(
    timeline: TimelineView, start: int, stop: int, stride: int, largest: int
) -> tuple[Motion, int]:
    """Return the next snapshots that fit into a batch, at least one, and the frame after them."""
    parts = [timeline.motion(start, start)]
    room = largest
    for at in range(start, stop, WINDOWS_PER_READ * stride):
        part = timeline.motion(at, min(at + WINDOWS_PER_READ * stride, stop), stride)
        sizes = _hinge(part) * part.offsets[1:] + WINDOW_HEADER_BYTES * np.arange(1, len(part) + 1)
        fitting = int(np.searchsorted(sizes, room, "right"))
        if fitting < len(part):
            fitting = max(fitting, int(at == start))
            parts.append(part[:fitting])
            return Motion.joined(parts), at + fitting * stride
        room -= int(sizes[-1])
        parts.append(part)
    return Motion.joined(parts), stop


def thinned(timeline: TimelineView, stride: int) -> bytes:
    """Return a finished timeline in one batch: every ``stride``-th frame and the last.

    Raises:
        TimelineError: If the timeline is being replaced.
    """
    if stride == 1:
        return batch_of(timeline, largest=UNLIMITED_BYTES)
    parts: list[Motion] = [timeline.motion(0, len(timeline), stride)]
    if (len(timeline) - 1) % stride:
        parts.append(timeline.motion(len(timeline) - 1, len(timeline)))
    return _joined(timeline, parts)


def chosen(timeline: TimelineView, frames: NDArray[np.int64]) -> bytes:
    """Return some frames of a finished dense timeline in one batch, renumbered.

    Raises:
        TimelineError: If the timeline is being replaced.
    """
    return _joined(timeline, [timeline.motion(0, len(timeline))[frames]])


def _joined(timeline: TimelineView, parts: Sequence[Motion]) -> bytes:
    with tempfile.TemporaryDirectory() as place:
        path = f"{place}/timeline"
        with TimelineWriter.create(path, timeline.chain, windowed=timeline.windowed) as writer:
            for part in parts:
                writer.append(part)
        return batch_of(TimelineView(path), largest=UNLIMITED_BYTES)
