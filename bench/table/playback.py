"""Playback on the table: how closely motors of limited torque follow a recorded explosion.

``python -m bench --only table-playback`` runs whole folds, as ``foldback fold --world table`` does.
Simulated frames are also released in plain MuJoCo.
"""

from __future__ import annotations

import json
import time
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from bench.sections import Section
from bench.table.folds import SMALL_BOXES
from bench.table.paths import SHAPES
from foldback.planner.pipeline.playing_back import MIN_SIZING_TORQUE_WP, TABLE_MOTOR_RESERVE
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.verification.verify import verify
from tests.planner.table_replay import TableReplay, table_replay

GALLERY_SHAPES: Final = ("mallet-24", "mallet-64", "letter-l", "letter-f")
"""Shapes of the gallery that are folded."""
MAX_RMS_PITCH, STRETCH_RMS_PITCH = 0.05, 0.01
"""Maximum RMS position error of a playback, and a stretch goal, in pitches."""


def table_playback(reference_seconds: float) -> Section:
    """Fold boxes and solids on the table after an explosion there."""
    del reference_seconds
    section = Section(name="table-playback")
    for name, data in _shapes().items():
        with TemporaryDirectory(prefix="foldback-table-") as directory:
            _shape(section, name, data, FilePath(directory))
    return section


def _shapes() -> dict[str, bytes]:
    boxes = {
        name: json.dumps(np.argwhere(np.ones(sides, dtype=bool)).tolist()).encode()
        for name, sides in SMALL_BOXES.items()
    }
    return {**boxes, **{name: (SHAPES / f"{name}.json").read_bytes() for name in GALLERY_SHAPES}}


def _shape(section: Section, name: str, data: bytes, directory: FilePath) -> None:
    start_s = time.perf_counter()
    Workspace(directory).write_request(FoldRequest(world="table", as_voxels=True), data)
    run_stages(directory)
    seconds = time.perf_counter() - start_s
    plan, played = Workspace(directory).read_plan(), Workspace(directory).read_playback()
    table = plan.certificate.table
    if played is None or table is None or table.torque is None or table.frame is None:
        section.add(f"{name}: playback", plan.certificate.verdict, "", False)
        return
    chain = plan.chain
    expected, actual = (
        chain.poses(frames.joint_angles_rad, frames.root_position, frames.root_wxyz).positions
        for frames in (plan.motion.dense(chain), played.frames.dense(chain))
    )
    errors = np.sqrt(((expected - actual) ** 2).sum(axis=2).mean(axis=1))
    rms = float(np.sqrt((errors**2).mean()))
    torque = max(table.torque, MIN_SIZING_TORQUE_WP)
    limit = TABLE_MOTOR_RESERVE * torque
    used = (plan.certificate.peak_torque_nm or 0.0) / table.unit_nm
    rests = table_replay(chain, played.frames, torque=torque, also=(table.frame,))
    section.rows.append(
        {
            "shape": name,
            "modules": len(chain),
            "verdict": plan.certificate.verdict,
            "again": "verified" if verify(directory).verified else "refused",
            "attempts": len(plan.attempts),
            "certified_wp": table.torque,
            "clearance": plan.certificate.min_clearance,
            "rms_pitches": rms,
            "worst_pitches": float(errors.max()),
            "end_pitches": float(errors[-1]),
            "most_rad": played.max_angle_error_rad,
            "torque_wp": used,
            "replay_pitches": max(rests.drifts),
            "replay_late": max(rests.still_drifts),
            "s": seconds,
        }
    )
    section.add(
        f"{name}: RMS of positions, motors of {used / torque:.2f} times the certificate, "
        f"without friction",
        f"{rms:.4f} pitches, {errors[-1]:.4f} at the end, {plan.certificate.verdict}",
        f"≤ {MAX_RMS_PITCH:g} (stretch {STRETCH_RMS_PITCH:g})",
        plan.certificate.verified and rms <= MAX_RMS_PITCH and used <= 1.05 * limit,
    )
    _add_replay(section, name, rests)


def _add_replay(section: Section, name: str, rests: TableReplay) -> None:
    section.add(
        f"{name}: {len(rests.frames)} frames, with the one that asks most, let go in plain "
        "MuJoCo, brakes of 1.1 times it",
        f"gone by {max(rests.drifts):.3f} pitches at most, {max(rests.still_drifts):.3f} in the "
        "last half of the time",
        "still",
        rests.holds,
    )
