"""A fold in one HTML file: the parts of the plan that it contains and uses."""

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foldback import foldback_check
from foldback.planner.motion.timeline import TimelineWriter
from foldback.planner.plan.plan import Plan
from foldback.web.timeline.frame_batch import batch_of
from foldback.web.timeline.view import TimelineView
from foldback.web.viser import standalone
from foldback.web.viser.standalone import WINDOW_ANGLES, standalone_html
from tests.web.timeline.decoding import decode


def parts_of(timeline: Path, plan: Path) -> dict[str, Any]:
    """Return the data of the page besides its scripts."""

    def render(**values: Any) -> str:
        return values["parts"]

    return json.loads(
        standalone_html(TimelineView(timeline), render, {}, plan=plan, stored_parts={})
    )


def round_trip(path: Path, plan: Plan) -> Path:
    with TimelineWriter.create(path, plan.chain, windowed=True) as writer:
        for phase, motion in (("explosion", plan.motion[::-1]), ("playback", plan.motion)):
            times = np.arange(len(motion), dtype=float)
            writer.append(motion.with_columns(time_s=times, phase=phase))
    return path


@pytest.mark.parametrize("simulated", [False, True])
def test_plan_is_in_the_page_and_proved_from_there(
    simulated: bool, peeled: Path, kinematic: Path, tmp_path: Path
) -> None:
    plan = (peeled if simulated else kinematic) / "plan.npz"
    timeline = peeled / "timeline"
    if not simulated:
        timeline = round_trip(tmp_path / "timeline", Plan.load(plan))
    parts = parts_of(timeline, plan)
    (held_plan := tmp_path / "held.npz").write_bytes(base64.b64decode(parts["plan"]))
    whole_check, part = (foldback_check.check(path) for path in (plan, held_plan))
    assert part["verdict"] == "proved"
    assert part["clearance"] == whole_check["clearance"]
    assert foldback_check.Plan(held_plan).digest == foldback_check.Plan(plan).digest
    # The angles of robots with errors differ from the plan's; other angles are in the page once.
    header, columns = decode(base64.b64decode(parts["batch"]))
    assert header["total"] == len(TimelineView(timeline))
    _, frame_columns = decode(batch_of(TimelineView(timeline)))
    missing = set() if simulated else WINDOW_ANGLES
    assert columns.keys() == frame_columns.keys() - missing


def test_motion_that_is_thinned_comes_without_the_plan(
    monkeypatch: pytest.MonkeyPatch, kinematic: Path, tmp_path: Path
) -> None:
    monkeypatch.setattr(standalone, "MAX_STANDALONE_BYTES", 1000)
    plan = kinematic / "plan.npz"
    parts = parts_of(round_trip(tmp_path / "timeline", Plan.load(plan)), plan)
    _, columns = decode(base64.b64decode(parts["batch"]))
    assert parts["plan"] is None
    assert columns.keys() >= WINDOW_ANGLES
