"""Figures of a fold as messages for a browser, curves first, then stretch by stretch.

Messages are those of ``web.timeline.columns``. The curves' header holds the number of ``frames``,
the number of ``rows`` per stretch and the ``largest`` torque and position error. A stretch holds
the clearances, nearest modules, torques and position errors of its frames, ``widths`` columns each.
Simulated windows have position errors only; other windows have no stretches.

For a fold on a table, torques are those of static equilibrium, in w·p (``joint_torque``), with each
module's force on the table in module weights (``pressed``). The curve of the largest torques is
``table_torque``, and ``table`` in the header holds 1 w·p in N·m, the permitted torque, the
bound of the explosion, and a text about friction.
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.certificate.figures_store import Curves, Figures
from foldback.planner.certificate.table_figures import TableCertificate
from foldback.planner.certificate.table_forces import TableForces
from foldback.planner.errors import UNREADABLE, InputError
from foldback.planner.motion.angle_encoding import plan_columns
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import TableRecord
from foldback.planner.motion.timeline import Timeline
from foldback.planner.pipeline.fold_layout import result_path
from foldback.planner.storage.array_files import HEAD
from foldback.planner.storage.file_names import CERTIFICATE, FIGURES, FORCES, PLAN, RECORD, TIMELINE
from foldback.planner.storage.files import json_of
from foldback.web.timeline.cache import Cache, version_of
from foldback.web.timeline.columns import encode

Array = NDArray[np.float64]
_REFERENCES: Final[Cache[Motion]] = Cache(128 * 2**20, lambda motion: motion.nbytes)
_FORCES: Final[Cache[TableForces]] = Cache(
    64 * 2**20, lambda curves: curves.torques.nbytes + curves.pressed.nbytes
)
_MESSAGES: Final[Cache[bytes]] = Cache(32 * 2**20, len)


def cached_figures(directory: Path, derived_dir: Path, part: int | None = None) -> bytes:
    """Return ``curves_of``, or ``stretch_of`` a part; recent messages are cached.

    Args:
        directory: Directory of the fold.
        derived_dir: Directory with its figures.
        part: Number of the stretch; None for the curves.

    Raises:
        TimelineError: If there are no figures, or no such stretch.
        OSError: If they are being replaced.
    """
    parts = [derived_dir / FIGURES / HEAD, result_path(directory, TIMELINE) / HEAD]
    parts += [path for path in (result_path(directory, FORCES),) if path.exists()]
    key = (directory, part, *map(version_of, parts))
    return _MESSAGES.get_or_make(
        key,
        lambda: (
            curves_of(directory, derived_dir)
            if part is None
            else stretch_of(directory, derived_dir, part)
        ),
    )


def curves_of(directory: Path, derived_dir: Path) -> bytes:
    """Return the data of a plot of all frames.

    Raises:
        TimelineError: If there are no figures.
    """
    curves = Curves.load(derived_dir / FIGURES)
    timeline = Timeline.open(result_path(directory, TIMELINE))
    total = len(timeline)
    error = 0.0
    if total and (reference := _reference(directory, timeline)) is not None:
        # All at once: reading single frames from a timeline takes ten times as long.
        errors = _position_errors(timeline, 0, total, reference, -(-total // 48))
        error = float(np.nan_to_num(errors, nan=0.0).max(initial=0.0))
    forces = _forces(directory, timeline)
    columns = {f.name: _plain(getattr(curves, f.name)) for f in fields(Curves)}
    largest = _largest(curves.peak_torque_nm)
    if forces is not None:
        del columns["peak_torque_nm"]  # computed for a floating chain
        columns["table_torque"] = _placed(forces.torque[:, None], 0, total, total)[:, 0]
        largest = _largest(forces.torque)
    header = {
        "frames": len(curves),
        "rows": _rows(timeline, forces),
        "table": None if forces is None else _table_told(directory),
        # For windows, torques are computed at some frames only: see
        # ``planner.certificate.frame_figures``.
        "torque_at_some_frames": timeline.windowed,
        "largest": {
            "torque": largest,
            "joint_torque": largest,
            "pressed": 0.0 if forces is None else _largest(forces.pressed),
            "position_error": error,
        },
    }
    return encode(header, columns)


def stretch_of(directory: Path, derived_dir: Path, part: int) -> bytes:
    """Return the figures of the modules and hinges in one stretch of frames.

    Raises:
        TimelineError: If there are no figures, or no such stretch.
    """
    timeline = Timeline.open(result_path(directory, TIMELINE))
    forces, total = _forces(directory, timeline), len(timeline)
    rows = _rows(timeline, forces)
    start, stop = part * rows, min((part + 1) * rows, total)
    reference = _reference(directory, timeline)
    if timeline.windowed and reference is not None:
        sent_columns: dict[str, NDArray[Any]] = {}
    else:
        figures = Figures.load(derived_dir / FIGURES, start, stop)
        sent_columns = {
            "clearance": figures.clearance,
            "nearest": figures.nearest,
            "torque": figures.torque_nm,
        }
    if forces is not None:
        sent_columns.pop("torque", None)
        sent_columns |= _at_frames(forces, start, stop, total)
    sent_columns["position_error"] = _position_errors(timeline, start, stop, reference)
    columns = {name: _plain(values) for name, values in sent_columns.items()}
    return encode({"widths": {name: v.shape[1] for name, v in columns.items()}}, columns)


def table_forces(directory: Path) -> bytes | None:
    """Return torques and table forces of all frames in one stretch; None for floating folds.

    Torques and forces are accurate to half a per cent, which keeps the message small.

    Raises:
        TimelineError: If there is no timeline.
    """
    timeline = Timeline.open(result_path(directory, TIMELINE))
    if (forces := _forces(directory, timeline)) is None:
        return None
    total = len(timeline)
    columns = _at_frames(forces, 0, total, total)
    widths = {name: values.shape[1] for name, values in columns.items()}
    return encode({"widths": widths}, columns, short=frozenset(columns))


def _forces(directory: Path, timeline: Timeline) -> TableForces | None:
    """Return the forces of a fold on a table; None if it floats or they do not match its frames."""
    path = result_path(directory, FORCES)
    try:
        forces = _FORCES.get_or_make(version_of(path), lambda: TableForces.load(path))
    except (OSError, InputError):
        return None
    chain = timeline.chain
    shapes = (forces.torques.shape[1], forces.pressed.shape[1])
    fitting = len(forces) <= len(timeline) and shapes == (len(chain.folded_rad), len(chain))
    return forces if fitting else None


def _at_frames(
    forces: TableForces, start: int, stop: int, total: int
) -> dict[str, NDArray[np.float32]]:
    return {
        "joint_torque": _placed(np.abs(forces.torques), start, stop, total),
        "pressed": _placed(forces.pressed, start, stop, total),
    }


def _placed(values: NDArray[np.float32], start: int, stop: int, total: int) -> NDArray[np.float32]:
    """Return the rows of some frames; ``values`` end with the timeline, earlier rows are NaN."""
    before = total - len(values)
    rows = np.full((stop - start, values.shape[1]), np.nan, dtype=np.float32)
    first = max(before, start)
    if first < stop:
        rows[first - start :] = values[first - before : stop - before]
    return rows


def _table_told(directory: Path) -> dict[str, Any] | None:
    """Return the table's figures that a plot shows beside its curve."""
    table_values = json_of(result_path(directory, CERTIFICATE)).get("table")
    if table_values is None:
        return None
    try:
        table = TableCertificate.from_dict(table_values)
        with np.load(result_path(directory, RECORD), allow_pickle=False) as arrays:
            record = TableRecord.of(arrays)
    except (InputError, *UNREADABLE):
        return None
    return {
        "unit_nm": table.unit_nm,
        "bound": table.bound,
        "kept": None if record is None else record.bound,
        "words": table.base_text,
    }


def _rows(timeline: Timeline, forces: TableForces | None) -> int:
    numbers = 3 * len(timeline.chain) + len(timeline.chain.folded_rad)
    if forces is not None:
        numbers += len(timeline.chain)
    return max(1, min(128, 2**18 // numbers))


def _reference(directory: Path, timeline: Timeline) -> Motion | None:
    """Return the playback's reference motion; None without one, or without recorded errors.

    Only the angles are read, because loading a whole plan would import the physics.
    """
    if not timeline.tells_errors:
        return None
    path = directory / PLAN
    try:
        # Cached, because each of the fold's many stretches needs the reference.
        reference = _REFERENCES.get_or_make(
            version_of(path),
            lambda: Motion.from_angles(**plan_columns(path, timeline.chain.folded_rad)),
        )
    except UNREADABLE:
        return None
    return reference if len(reference) else None


def _position_errors(
    timeline: Timeline,
    start: int,
    stop: int,
    reference: Motion | None,
    stride: int = 1,
) -> Array:
    """Return (F, N) distances of modules from their positions without joint errors, in pitches.

    The root is assumed to have no error. NaN where no errors are recorded.
    """
    chain, frames = timeline.chain, timeline.frames(start, stop, stride)
    errors = np.full((len(frames), len(chain)), np.nan)
    if reference is None:
        return errors
    # A plan's frames are the last ones of its timeline.
    place = np.arange(start, stop, stride) - (len(timeline) - len(reference))
    has_reference = np.isfinite(frames.joint_error_rad).all(axis=1) & (place >= 0)
    if not has_reference.any():
        return errors
    root = (frames.root_position[has_reference], frames.root_wxyz[has_reference])
    reference_rad = reference[place[has_reference]]
    reference_poses = chain.poses(reference_rad.angles(chain), *root)
    poses = chain.poses(frames.joint_angles_rad[has_reference], *root)
    errors[has_reference] = np.linalg.norm(reference_poses.positions - poses.positions, axis=-1)
    return errors


def _largest(values: NDArray[Any]) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if len(finite) else 0.0


def _plain(values: NDArray[Any]) -> NDArray[Any]:
    return values.astype("<i4" if values.dtype.kind in "iu" else "<f4")
