"""Measured: the figures of a fold as messages for a browser, curves first, then stretch by stretch.

Messages are those of ``web.timeline.columns``. The curves' header tells ``frames``, how many
``rows`` a stretch has and the ``largest`` torque and position error; a stretch holds the
clearances, nearest modules, torques and position errors of its frames, ``widths`` columns each. Of
simulated windows there are position errors alone, of others no stretches.
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any, Final
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from planner.certificate.metrics import Curves, Figures
from planner.chain.chain import Chain
from planner.motion.angle_steps import plan_angles, plan_window_angles
from planner.motion.timeline import Timeline
from planner.motion.windows import Windows
from planner.pipeline.attempt_folders import TIMELINE, result
from web.timeline.cache import Cache
from web.timeline.columns import encode

STRETCH_NUMBERS: Final = 2**18
MOST_ROWS: Final = 128
SAMPLES: Final = 48
"""Frames, spread over the fold, from which the largest position error is told."""
FIGURES: Final = "figures.zarr"
Array = NDArray[np.float64]
_REFERENCES: Final[Cache[Array | Windows]] = Cache(128 * 2**20, lambda kept: _bytes(kept))
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
    if total and (reference := _reference(directory, timeline)) is not None:
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
    reference = _reference(directory, timeline)
    if timeline.windowed and reference is not None:
        found: dict[str, NDArray[Any]] = {}
    else:
        figures = Figures.load(directory / FIGURES, start, stop)
        found = {
            "clearance": figures.clearance,
            "nearest": figures.nearest,
            "torque": figures.torque_nm,
        }
    found["position_error"] = _position_errors(timeline, start, stop, reference)
    columns = {name: _plain(values) for name, values in found.items()}
    return encode({"widths": {name: v.shape[1] for name, v in columns.items()}}, columns)


def _rows(timeline: Timeline) -> int:
    numbers = 3 * len(timeline.chain) + len(timeline.chain.folded_rad)
    return max(1, min(MOST_ROWS, STRETCH_NUMBERS // numbers))


def _reference(directory: Path, timeline: Timeline) -> Array | Windows | None:
    """What the playback was to follow; None when there was none, or windows without errors.

    Its angles are read as they lie in the file: a whole plan would bring the physics along.
    """
    if not timeline.tells_errors:
        return None
    path = directory / "plan.npz"
    try:
        found = path.stat()
        # Every stretch asks for them, of which a fold has many.
        key = (path, found.st_ino, found.st_mtime_ns)
        reference = _REFERENCES.get(key)
        if reference is None:
            if timeline.windowed:
                reference = _plan_windows(path, timeline.chain)
            else:
                reference = plan_angles(path)
                reference.flags.writeable = False
            _REFERENCES.keep(key, reference)
    except (OSError, ValueError, KeyError, BadZipFile):
        return None
    return reference if len(reference) else None


def _plan_windows(path: Path, chain: Chain) -> Windows:
    """The frames of a plan of windows, without what was off."""
    first, offsets, angles = plan_window_angles(path, chain.folded_rad)
    count = len(first)
    return Windows(
        time_s=np.zeros(count),
        phase=np.zeros(count, np.uint8),
        first=first,
        offsets=offsets,
        angles_rad=angles,
        base_position=np.zeros((count, 3)),
        base_wxyz=np.zeros((count, 4)),
    )


def _position_errors(
    timeline: Timeline,
    start: int,
    stop: int,
    reference: Array | Windows | None,
    stride: int = 1,
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
    wanted = reference[place[known]]
    meant = chain.poses(wanted.angles(chain) if isinstance(wanted, Windows) else wanted, *root)
    there = chain.poses(frames.joint_angles_rad[known], *root)
    errors[known] = np.linalg.norm(meant.positions - there.positions, axis=-1)
    return errors


def _bytes(reference: Array | Windows) -> int:
    if isinstance(reference, Windows):
        return reference.angles_rad.nbytes + 80 * len(reference)
    return reference.nbytes


def _largest(values: NDArray[Any]) -> float:
    known = values[np.isfinite(values)]
    return float(known.max()) if len(known) else 0.0


def _plain(values: NDArray[Any]) -> NDArray[Any]:
    return values.astype("<i4" if values.dtype.kind in "iu" else "<f4")
