"""Results of a fold that a limit or its owner stopped."""

from __future__ import annotations

import json
from pathlib import Path as FilePath

import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.chain.path import Path
from planner.motion.motion import Motion
from planner.motion.timeline import Timeline, TimelineWriter, chain_from_attributes
from planner.pipeline.attempt import Attempt, Trial
from planner.pipeline.request import FoldRequest
from planner.pipeline.stages import run_stage
from planner.pipeline.workspace import Workspace
from planner.plan.shape_files import write_path
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


def test_it_tells_which_modules_are_still_bent(tmp_path: FilePath) -> None:
    recorded(tmp_path / "timeline.zarr", CHAIN, 0.8)
    stuck = Workspace(tmp_path).settle()["stuck"]
    bends = np.abs(CHAIN.folded_rad).reshape(-1, 2).max(axis=1) > 1.0
    assert stuck["modules"] == (np.flatnonzero(bends) + 1).tolist()
    assert stuck["kind"] == "stopped" and "still unfolding" in stuck["words"]


def test_slight_bends_count_where_there_are_no_others(tmp_path: FilePath) -> None:
    recorded(tmp_path / "timeline.zarr", CHAIN, 0.3)
    assert Workspace(tmp_path).settle()["stuck"]["modules"]
    recorded(tmp_path / "timeline.zarr", CHAIN, 1e-3)
    assert Workspace(tmp_path).settle()["stuck"]["modules"] == []


def test_of_a_playback_it_tells_what_is_not_folded_yet(tmp_path: FilePath) -> None:
    recorded(tmp_path / "timeline.zarr", CHAIN, 0.0, "playback")
    turns = np.flatnonzero(np.abs(CHAIN.folded_rad).reshape(-1, 2).max(axis=1) > 1.0) + 1
    assert Workspace(tmp_path).settle()["stuck"]["modules"] == turns.tolist()


def test_of_an_unfolding_it_tells_what_is_not_straight_yet(tmp_path: FilePath) -> None:
    """What is bent as the other shape is has to become straight first, too."""
    recorded(tmp_path / "timeline.zarr", CHAIN, 1.0, "unfolding")
    turns = np.flatnonzero(np.abs(CHAIN.folded_rad).reshape(-1, 2).max(axis=1) > 1.0) + 1
    assert Workspace(tmp_path).settle()["stuck"]["modules"] == turns.tolist()


def test_who_only_looks_changes_nothing(tmp_path: FilePath) -> None:
    attempted(tmp_path, CHAIN, 0.3)
    attempted(tmp_path, OTHER, 0.8)
    there = sorted(tmp_path.rglob("*"))
    bends = np.abs(OTHER.folded_rad).reshape(-1, 2).max(axis=1) > 1.0
    assert (
        Workspace(tmp_path).stopped_where()["stuck"]["modules"]
        == (np.flatnonzero(bends) + 1).tolist()
    )
    assert sorted(tmp_path.rglob("*")) == there
    assert Workspace(tmp_path / "nothing").stopped_where() == {}


@pytest.mark.parametrize(("left", "kept"), [(0.3, OTHER), (0.9, CHAIN)])
def test_the_explosion_that_came_farthest_stays(
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


def test_without_a_frame_there_is_nothing_to_tell(tmp_path: FilePath) -> None:
    assert Workspace(tmp_path).settle() == {}
    TimelineWriter.create(tmp_path / "timeline.zarr", CHAIN).close("failed")
    assert Workspace(tmp_path).settle() == {}


def test_what_was_tried_is_known_while_the_next_is_under_way(tmp_path: FilePath) -> None:
    cells = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1), (1, 0, 1)]
    Workspace(tmp_path).write_request(
        FoldRequest(), write_path(Path.from_cells(cells, name="hook"))
    )
    run_stage("read", tmp_path)
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
