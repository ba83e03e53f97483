"""Measured: the figures of a fold as messages for a browser, curves first, then stretch by stretch.

Messages are those of ``web.timeline.columns``. The curves' header tells ``frames``, how many
``rows`` a stretch has and the ``largest`` torque and position error; a stretch holds the
clearances, nearest modules, torques and position errors of its frames, ``widths`` columns each.
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any, Final
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from planner.certificate.metrics import Curves, Figures
from planner.motion.angle_steps import plan_angles
from planner.motion.timeline import Timeline
from planner.pipeline.attempt_folders import TIMELINE, result
from web.timeline.cache import Cache
from web.timeline.columns import encode

STRETCH_NUMBERS: Final = 2**18
MOST_ROWS: Final = 128
SAMPLES: Final = 48
"""Frames, spread over the fold, from which the largest position error is told."""
FIGURES: Final = "figures.zarr"
Array = NDArray[np.float64]
_REFERENCES: Final[Cache[Array]] = Cache(128 * 2**20, lambda angles: angles.nbytes)
_MESSAGES: Final[Cache[bytes]] = Cache(32 * 2**20, len)


def kept_figures(directory: Path, part: int | None = None) -> bytes:
    """``curves_of``, or ``stretch_of`` a part; those that were asked for lately are kept.

    Raises:
        TimelineError: When there are no figures, or no such stretch.
        OSError: When they are being replaced.
    """
    parts = (directory / FIGURES / "zarr.json", result(directory, TIMELINE) / "zarr.json")
    stamps = [(found.st_ino, found.st_mtime_ns) for found in (path.stat() for path in parts)]
    key = (directory, part, *stamps)
    if (data := _MESSAGES.get(key)) is None:
        data = curves_of(directory) if part is None else stretch_of(directory, part)
        _MESSAGES.keep(key, data)
    return data


def curves_of(directory: Path) -> bytes:
    """What a plot draws of every frame.

    Raises:
        TimelineError: When there are no figures.
    """
    curves = Curves.load(directory / FIGURES)
    timeline = Timeline.open(result(directory, TIMELINE))
    total = len(timeline)
    error = 0.0
    if total and (reference := _reference(directory)) is not None:
        # In one go: to ask a timeline for single frames takes ten times as long.
        found = _position_errors(timeline, 0, total, reference, -(-total // SAMPLES))
        error = float(np.nan_to_num(found, nan=0.0).max(initial=0.0))
    header = {
        "frames": len(curves),
        "rows": _rows(timeline),
        # Of windows torques are worked out at some frames only, see
        # ``planner.certificate.measure``.
        "torque_at_some_frames": timeline.windowed,
        "largest": {
            "torque": _largest(curves.peak_torque_nm),
            "position_error": error,
        },
    }
    return encode(header, {f.name: _plain(getattr(curves, f.name)) for f in fields(Curves)})


def stretch_of(directory: Path, part: int) -> bytes:
    """The figures of the modules and hinges in one stretch of frames.

    Raises:
        TimelineError: When there are no figures, or no such stretch.
    """
    timeline = Timeline.open(result(directory, TIMELINE))
    rows, total = _rows(timeline), len(timeline)
    start, stop = part * rows, min((part + 1) * rows, total)
    found = Figures.load(directory / FIGURES, start, stop)
    errors = _position_errors(timeline, start, stop, _reference(directory))
    columns = {
        "clearance": _plain(found.clearance),
        "nearest": _plain(found.nearest),
        "torque": _plain(found.torque_nm),
        "position_error": _plain(errors),
    }
    return encode({"widths": {name: v.shape[1] for name, v in columns.items()}}, columns)


def _rows(timeline: Timeline) -> int:
    numbers = 3 * len(timeline.chain) + len(timeline.chain.folded_rad)
    return max(1, min(MOST_ROWS, STRETCH_NUMBERS // numbers))


def _reference(directory: Path) -> Array | None:
    """The angles that the playback was to follow; None when there was none.

    They are read as they lie in the file: a whole plan would bring the physics along.
    """
    path = directory / "plan.npz"
    try:
        found = path.stat()
        # Every stretch asks for them, of which a fold has many.
        key = (path, found.st_ino, found.st_mtime_ns)
        angles = _REFERENCES.get(key)
        if angles is None:
            angles = plan_angles(path)
            angles.flags.writeable = False
            _REFERENCES.keep(key, angles)
    except (OSError, ValueError, KeyError, BadZipFile):
        return None
    return angles if len(angles) else None


def _position_errors(
    timeline: Timeline, start: int, stop: int, reference: Array | None, stride: int = 1
) -> Array:
    """(F, N) how far each module is from where it would be without joint errors, in pitches.

    The root is taken to be in its place. NaN where no errors are recorded.
    """
    chain, frames = timeline.chain, timeline.frames(start, stop, stride)
    errors = np.full((len(frames), len(chain)), np.nan)
    if reference is None:
        return errors
    # A plan's frames are the last ones of its timeline.
    place = np.arange(start, stop, stride) - (len(timeline) - len(reference))
    known = np.isfinite(frames.joint_error_rad).all(axis=1) & (place >= 0)
    if not known.any():
        return errors
    root = (frames.root_position[known], frames.root_wxyz[known])
    meant = chain.poses(reference[place[known]], *root)
    there = chain.poses(frames.joint_angles_rad[known], *root)
    errors[known] = np.linalg.norm(meant.positions - there.positions, axis=-1)
    return errors


def _largest(values: NDArray[Any]) -> float:
    known = values[np.isfinite(values)]
    return float(known.max()) if len(known) else 0.0


def _plain(values: NDArray[Any]) -> NDArray[Any]:
    return values.astype("<i4" if values.dtype.kind in "iu" else "<f4")
