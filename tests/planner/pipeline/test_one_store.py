"""Files of a fold hold each motion once."""

from itertools import combinations
from pathlib import Path as FilePath

import numpy as np
import pytest

from foldback.planner.exports import mjcf
from foldback.planner.motion.record import Record
from foldback.planner.motion.timeline import Timeline
from foldback.planner.pipeline.stages import run_stage
from foldback.planner.plan.plan import Plan
from foldback.planner.playback.playback import Playback
from foldback.planner.verification.verify import verify
from tests.planner.conftest import Folded
from tests.planner.folds import run_fold

MIN_FRAMES = 20
"""Number of frames from which an array counts as a motion; shorter ones are lists of figures."""


def motions_in(directory: FilePath) -> dict[str, np.ndarray]:
    """Return the arrays of angles in all files, by file and name; those of chunks joined."""
    parts: dict[str, list[np.ndarray]] = {}
    for path in sorted(directory.rglob("*.npz")):
        file = path.parent.name if path.stem.isdecimal() else path.name
        with np.load(path, allow_pickle=False) as opened:
            for name in opened.files:
                if name.endswith("angles_rad") or name in ("reference_rad", "snapshots_rad"):
                    parts.setdefault(f"{file} {name}", []).append(opened[name])
                elif name in ("others_rad", "mujoco_rad"):
                    parts.setdefault(f"{file} {name}", []).extend(np.atleast_3d(opened[name]))
    return {name: np.concatenate(arrays) for name, arrays in parts.items()}


def test_no_file_repeats_the_motion_of_another(folded: Folded) -> None:
    motions = motions_in(folded.directory)
    assert {"timeline joint_angles_rad", "plan.npz joint_angles_rad"} <= motions.keys()
    for (first, one), (second, other) in combinations(motions.items(), 2):
        rows = {row.tobytes() for row in one.reshape(len(one), -1)}
        repeated = sum(row.tobytes() in rows for row in other.reshape(len(other), -1))
        assert repeated < MIN_FRAMES, f"{second} repeats {repeated} frames of {first}"


def test_record_and_playback_are_read_from_timeline_and_plan(folded: Folded) -> None:
    timeline, plan = (
        Timeline.open(folded.directory / "timeline"),
        Plan.load(folded.directory / "plan.npz"),
    )
    for name in ("record.npz", "playback.npz"):
        with np.load(folded.directory / name, allow_pickle=False) as file:
            assert not {"time_s", "joint_angles_rad", "reference_rad"} & set(file.files)
    record = Record.load(folded.directory / "record.npz")
    playback = Playback.load(folded.directory / "playback.npz")
    assert record.frames.passes_as(timeline.explosion())
    assert playback.frames.passes_as(timeline.playback())
    assert playback.reference.passes_as(plan.motion)
    assert len(record.frames) + len(playback.frames) == len(timeline)


def test_fold_of_too_many_modules_has_no_model(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mjcf, "MAX_MODEL_MODULES", 7)
    run_fold(tmp_path, b"- - - + - -", module="tetrahedron")
    assert {"plan.npz", "plan.json", "model.xml"} & {p.name for p in tmp_path.iterdir()} == {
        "plan.npz",
        "model.xml",
    }
    monkeypatch.setattr(mjcf, "MAX_MODEL_MODULES", 6)
    run_stage("export", tmp_path)
    assert not (tmp_path / "model.xml").exists()
    verification = verify(tmp_path)
    assert verification.verified and verification.replay is None
    assert any("more than 6 modules have no model.xml" in note for note in verification.notes)
