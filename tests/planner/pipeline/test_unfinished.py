"""Results of a fold that a limit or its owner stopped."""

from __future__ import annotations

import json
from pathlib import Path as FilePath

import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.motion.motion import Motion
from planner.motion.timeline import Timeline, TimelineWriter, chain_from_attributes
from planner.pipeline.attempt import Attempt, Trial
from planner.pipeline.stages import run_stage
from planner.pipeline.workspace import Workspace
from planner.plan.shape_files import write_path
from tests.planner.chains import SQUARE
from tests.planner.folds import asked
from tests.planner.peels import snake

CHAIN = snake((2, 2, 3))
OTHER = snake((3, 2, 2))


def recorded(path: FilePath, chain: Chain, share: float, phase: str = "explosion") -> None:
    """A timeline that goes from folded to a share of its bends."""
    angles = np.linspace(1.0, share, 4)[:, None] * chain.folded_rad
    folded = chain.folded_poses
    frames = Motion.from_frames(
        phase=phase,
        time_s=np.arange(4.0),
        joint_angles_rad=angles,
        root_position=np.tile(folded.positions[chain.root], (4, 1)),
        root_wxyz=np.tile(folded.wxyzs[chain.root], (4, 1)),
    )
    with TimelineWriter.create(path, chain) as writer:
        writer.append(frames)


def attempted(directory: FilePath, chain: Chain, share: float) -> None:
    """One more attempt, which was ended when so much of its bends was left."""
    workspace = Workspace(directory)
    known = workspace.read_history()
    begun = Attempt(trial=Trial(len(known), 0, "peel"), status="begun")
    workspace.write_history([*known, begun])
    recorded(workspace.begin(len(known), chain).timeline, chain, share)


def bent(chain: Chain) -> list[int]:
    """Return the numbers of the modules between bent joints."""
    bends = np.abs(chain.folded_rad).reshape(-1, 2).max(axis=1) > 1.0
    return (np.flatnonzero(bends) + 1).tolist()


@pytest.mark.parametrize(
    ("phase", "share", "named"),
    [
        ("explosion", 0.3, True),  # slight bends count where there are no others
        ("explosion", 1e-3, False),
        ("playback", 0.0, True),
        ("unfolding", 1.0, True),  # bends of the other shape have to become straight first, too
    ],
)
def test_unfinished_fold_names_the_modules_that_are_not_there_yet(
    phase: str, share: float, named: bool, tmp_path: FilePath
) -> None:
    recorded(tmp_path / "timeline.zarr", CHAIN, share, phase)
    stuck = Workspace(tmp_path).settle()["stuck"]
    assert stuck["modules"] == (bent(CHAIN) if named else [])
    assert stuck["kind"] == "stopped"
    assert phase != "explosion" or "still unfolding" in stuck["words"]


def test_stopped_where_changes_no_file(tmp_path: FilePath) -> None:
    attempted(tmp_path, CHAIN, 0.3)
    attempted(tmp_path, OTHER, 0.8)
    there = sorted(tmp_path.rglob("*"))
    assert Workspace(tmp_path).stopped_where()["stuck"]["modules"] == bent(OTHER)
    assert sorted(tmp_path.rglob("*")) == there
    assert Workspace(tmp_path / "nothing").stopped_where() == {}
    assert Workspace(tmp_path / "nothing").settle() == {}
    TimelineWriter.create(tmp_path / "empty" / "timeline.zarr", CHAIN).close("failed")
    assert Workspace(tmp_path / "empty").settle() == {}


@pytest.mark.parametrize(("left", "kept"), [(0.3, OTHER), (0.9, CHAIN)])
def test_settle_keeps_the_explosion_that_came_farthest(
    left: float, kept: Chain, tmp_path: FilePath
) -> None:
    attempted(tmp_path, OTHER, left)
    attempted(tmp_path, CHAIN, 0.6)
    Workspace(tmp_path).settle()
    timeline = Timeline.open(tmp_path / "timeline.zarr")
    np.testing.assert_array_equal(timeline.chain.folded_rad, kept.folded_rad)
    told = chain_from_attributes(json.loads((tmp_path / "chain.json").read_text()))
    np.testing.assert_array_equal(told.folded_rad, kept.folded_rad)
    assert {path.name for path in tmp_path.iterdir()} == {
        *("attempts.json", "chain.json", "timeline.zarr")
    }


def test_history_names_the_attempt_under_way(tmp_path: FilePath) -> None:
    run_stage("read", asked(tmp_path, write_path(SQUARE)))
    seen: list[object] = []

    def look() -> bool:
        seen.append(json.loads((tmp_path / "attempts.json").read_text()))
        return False

    run_stage("explode", tmp_path, cancelled=look)
    begun = Attempt(trial=Trial(0, 0, "simultaneous"), status="begun")
    assert seen[0] == [begun.as_dict()]
    (after,) = Workspace(tmp_path).read_history()
    assert after.status == "straight"
    # Cut off there, it begins anew.
    Workspace(tmp_path).write_history([begun])
    assert run_stage("explode", tmp_path)["attempts"] == 1
