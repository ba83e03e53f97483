"""What `foldback play` says of a directory that holds no verified plan."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from planner.motion.frames import Frames
from planner.motion.timeline import TimelineWriter
from server.cli.play import row_of
from server.pages.failures import failure
from tests.planner.peels import snake

CHAIN = snake((2, 2, 3))
KNOT = {"kind": "knot", "modules": [5, 6], "words": "its path is knotted"}


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    """An explosion that was ended half-way."""
    folded = CHAIN.folded_poses
    frames = Frames.of_phase(
        "explosion",
        time_s=np.arange(2.0),
        joint_angles_rad=np.array([1.0, 0.8])[:, None] * CHAIN.folded_rad,
        root_position=np.tile(folded.positions[CHAIN.root], (2, 1)),
        root_wxyz=np.tile(folded.wxyzs[CHAIN.root], (2, 1)),
    )
    with TimelineWriter.create(tmp_path / "timeline.zarr", CHAIN) as writer:
        writer.append(frames)
    return tmp_path


def told(directory: Path) -> dict[str, Any]:
    row = row_of(directory)
    found = failure(row, row.summary)
    assert found is not None
    return found


def test_a_stuck_plan_says_why_and_where(directory: Path) -> None:
    explosion = {"status": "stalled", "reason": "it stuck", "steps": 90, "frames": 2}
    plan = {
        "certificate": {"verdict": "failed: the explosion stalled: it stuck"},
        "explosion": explosion,
        "attempts": [{**explosion, "steps": 8}, {**explosion, "diagnosis": KNOT}],
    }
    (directory / "plan.json").write_text(json.dumps(plan))
    found = told(directory)
    assert (found["heading"], found["modules"]) == ("Stuck: a knot", [5, 6])


def test_what_came_to_no_plan_says_how_far_it_came(directory: Path) -> None:
    before = sorted(directory.iterdir())
    found = told(directory)
    assert (found["heading"], found["text"]) == ("Not finished", "It was still on its way.")
    assert len(found["modules"]) > 2
    assert sorted(directory.iterdir()) == before
