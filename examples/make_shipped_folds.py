"""Make the finished folds that ship with the package: server/shipped_folds/*.fold.

python examples/make_shipped_folds.py [NAME …]

Each is folded by the product. Two roundings make the file small: that of the explosion's record,
before it is played back, so that a repeated simulation gives the same playback; and that of the
simulated errors, after which the motions are certified again. The plan itself is not rounded.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from foldback.planner.certificate.figures_store import Figures, write
from foldback.planner.motion.angle_encoding import PLAN_STEP_RAD
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import Record
from foldback.planner.motion.timeline import TimelineWriter
from foldback.planner.pipeline import manifest
from foldback.planner.pipeline.derived_files import complete
from foldback.planner.pipeline.packed_fold import (
    CLEARANCE_STEP_PITCH,
    ROOT_STEPS,
    pack,
    torque_step,
    unpack,
)
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stage, run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.playback.playback import Playback
from foldback.planner.readers.gallery import Gallery
from foldback.planner.storage.file_names import (
    ARRAY_FOLDERS,
    DESCRIBED,
    FIGURES,
    PLAN,
    PLAYBACK,
    RECORD,
    START_CHAIN,
    TIMELINE,
)
from foldback.server.submission.shipped_folds import SHIPPED_FOLDS_DIR

SHAPES = Path(__file__).parent / "shapes"
FOLDS: tuple[tuple[str, str | None], ...] = (
    ("wrench-160", None),
    ("pawn", None),
    ("tetra-wrench", None),
    ("tetra-cube-2", None),
    ("mallet-80", "wrench-80"),
)
"""Shapes to fold; a refold also names the shape that it starts from."""
RECORD_STEP_RAD = PLAN_STEP_RAD * 2**7
"""Step of the explosion's angles, 2.4e-5 rad: invisible, and it halves their size."""
ERROR_STEP_RAD = PLAN_STEP_RAD * 2**5
"""Step of the simulated errors, 6e-6 rad: a twentieth of the largest ones."""


def fold_into(directory: Path, shape: str, start: str | None) -> None:
    """Fold a shape as a service would, but play back a rounded explosion and round its errors."""
    request_fold(directory, shape, refold=start is not None)
    if start is not None:
        with tempfile.TemporaryDirectory() as place:
            request_fold(Path(place), start, refold=False)
            run_stages(Path(place))
            Workspace(directory).write_start(Plan.load(Path(place) / PLAN))
    run_stages(directory, until="play_back")
    round_record(Workspace(directory).attempt)
    run_stages(directory, first="play_back")
    round_errors(directory)


def request_fold(directory: Path, shape: str, *, refold: bool) -> None:
    """Write the request for a fold of a shape."""
    path = SHAPES / f"{shape}.json"
    request = FoldRequest(filename=path.name, refold=refold)
    Workspace(directory).write_request(request, path.read_bytes())


def in_steps(values: np.ndarray, step: float) -> np.ndarray:
    """Return values rounded to whole steps; none is −0, which would have bytes of its own."""
    return np.rint(values / step) * step + 0.0


def rounded(frames: Motion, angles_rad: np.ndarray, errors_rad: np.ndarray) -> Motion:
    """Return frames with other angles and errors, and roots in whole steps."""
    return frames.with_columns(
        joint_angles_rad=angles_rad,
        joint_error_rad=errors_rad,
        **{name: in_steps(getattr(frames, name), step) for name, step in ROOT_STEPS.items()},
    )


def round_record(attempt: Workspace) -> None:
    """Round the record of an attempt that is to be played back."""
    record = attempt.read_record()
    assert record is not None
    frames = record.frames
    assert not frames.is_windowed
    angles = np.rint(frames.joint_angles_rad / RECORD_STEP_RAD) * (RECORD_STEP_RAD / PLAN_STEP_RAD)
    angles = angles * PLAN_STEP_RAD + 0.0
    undefined = np.full_like(frames.joint_error_rad, np.nan)
    record = replace(record, frames=rounded(frames, angles, undefined))
    refold = (attempt.directory.parent.parent / START_CHAIN).exists()
    record.save(attempt.directory / RECORD, frames=refold)
    with TimelineWriter.create(attempt.timeline, attempt.read_chain()) as writer:
        writer.append(record.frames)


def round_errors(directory: Path) -> None:
    """Round the errors of the simulated playbacks, and certify them as they are then."""
    playback = Playback.load(directory / PLAYBACK)
    played, reference = playback.frames, playback.reference_rad
    assert not played.is_windowed and reference is not None
    steps = np.rint(reference / PLAN_STEP_RAD)
    reference = np.asarray(reference) + 0.0

    def with_rounded_errors(angles_rad: np.ndarray) -> np.ndarray:
        """Round towards the largest error that the simulation reported, never beyond."""
        max_steps = np.floor((playback.max_angle_error_rad or np.inf) / ERROR_STEP_RAD)
        errors = np.rint((angles_rad - reference) / ERROR_STEP_RAD).clip(-max_steps, max_steps)
        return (steps + errors * (ERROR_STEP_RAD / PLAN_STEP_RAD)) * PLAN_STEP_RAD + 0.0

    simulated = with_rounded_errors(played.joint_angles_rad)
    others_rad, mujoco_rad = playback.others_rad, playback.mujoco_rad
    playback = replace(
        playback,
        frames=rounded(played, simulated, np.abs(simulated - reference)),
        reference_rad=reference,
        others_rad=None if others_rad is None else with_rounded_errors(np.asarray(others_rad)),
        mujoco_rad=None if mujoco_rad is None else with_rounded_errors(np.asarray(mujoco_rad)),
    )
    playback.save(directory / PLAYBACK)
    _write_timeline(directory)
    run_stage("certify", directory)
    certificate = Workspace(directory).read_certificate()
    assert certificate is not None
    ends = certificate.rms_position_error  # of the rounded angles
    replace(playback, rms_position_error=ends).save(directory / PLAYBACK)
    run_stage("export", directory)
    complete(directory)
    _round_figures(directory)
    manifest.write_manifest(directory)


def _write_timeline(directory: Path) -> None:
    record, playback = (
        Record.load(directory / RECORD),
        Playback.load(directory / PLAYBACK),
    )
    refold = (directory / START_CHAIN).exists()
    with TimelineWriter.create(directory / TIMELINE, Workspace(directory).read_chain()) as writer:
        if not refold:
            writer.append(record.frames)
        writer.append(playback.frames)


def _round_figures(directory: Path) -> None:
    """Round plotted figures: clearances down, torques to at most 1/64 of the largest one."""
    path = directory / FIGURES
    figures = Figures.load(path)
    step = torque_step(figures.torque_nm.astype(float))
    down = np.floor(figures.clearance.astype(float) / CLEARANCE_STEP_PITCH) * CLEARANCE_STEP_PITCH
    figures = replace(
        figures,
        clearance=down.astype(np.float32),
        torque_nm=in_steps(figures.torque_nm.astype(float), step).astype(np.float32),
    )
    write([figures], path)


def row_values(directory: Path, shape: str, start: str | None) -> dict[str, Any]:
    """Return the values that a service stores of the fold in its row."""
    gallery_shape = Gallery().shape(shape)
    assert gallery_shape is not None
    plan = Plan.load(directory / PLAN)
    return {
        "shape": shape,
        "name": gallery_shape.title,
        "refold": start,
        "version": plan.versions["foldback"],
        "summary": plan.summary(),
    }


def _digests(directory: Path) -> manifest.Digests:
    """Return digests of a fold's files, except for those that are divided into other chunks."""
    names = [name for name in DESCRIBED if name not in ARRAY_FOLDERS]
    return manifest.digests_of(directory, names)


def main() -> None:
    """Make all of them, or those that are named."""
    SHIPPED_FOLDS_DIR.mkdir(exist_ok=True)
    for shape, start in FOLDS:
        name = shape if start is None else f"{start}-to-{shape}"
        if sys.argv[1:] and name not in sys.argv[1:]:
            continue
        with (
            tempfile.TemporaryDirectory() as place,
            tempfile.TemporaryDirectory() as verified_place,
        ):
            fold_into(Path(place), shape, start)
            data = pack(Path(place), row_values(Path(place), shape, start))
            unpack(data, Path(verified_place))
            assert _digests(Path(verified_place)) == _digests(Path(place))
        (SHIPPED_FOLDS_DIR / f"{name}.fold").write_bytes(data)
        print(f"{name}: {len(data) / 1e3:.0f} kB", flush=True)


if __name__ == "__main__":
    main()
