"""No plan is called verified that MuJoCo, the exported model and the plan's angles contradict."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from planner.chain.path import Path
from planner.chain.rotations import aligned_distances
from planner.exports import mjcf
from planner.plan.plan import Plan
from planner.plan.shape_files import write_chain
from planner.readers import read
from tests.planner.conftest import SHAPES
from tests.planner.folds import made
from tests.planner.outsider import Outsider, moment_at, moments
from tests.planner.peels import snake
from tests.planner.plans import changed

pytestmark = pytest.mark.slow

QUARTERS = 4
POSES_WITHIN = 1e-6
OVERLAP_WITHIN = 1e-9
DISTANCE_WITHIN = 1e-5
"""MuJoCo's own distances of hulls are found by iteration."""
QUICK = ("wrench-24", "mallet-24")
"""Folded within a moment, or by other tests anyway."""
ALL = [
    pytest.param(name, marks=() if name in QUICK else pytest.mark.long)
    for name in sorted(file.stem for file in SHAPES.glob("*.json"))
]


def check(plan: Plan, xml: str) -> int:
    """Replays a plan; the number of configurations looked at."""
    assert plan.verified, plan.certificate.verdict
    chain, frames = plan.chain, plan.whole()
    outsider = Outsider(xml, list(chain.joint_names), chain.root)
    assert len(outsider.positions) == len(chain)
    count, off, overlap = 0, 0.0, 0.0
    for moment in moments(frames, QUARTERS):
        outsider.put(moment)
        ours = chain.poses(moment.angles, moment.position, moment.wxyz).positions
        off = max(off, float(np.linalg.norm(outsider.positions - ours, axis=1).max()))
        overlap = max(overlap, outsider.overlap())
        count += 1
    assert off < POSES_WITHIN
    assert overlap <= OVERLAP_WITHIN
    certificate = plan.certificate
    place = certificate.min_clearance_at
    if place is not None and place.modules is not None:
        outsider.put(moment_at(frames, place.frame))
        assert certificate.min_clearance is not None
        # Separating axes tell at most the distance; across a corner of both it is √3 times that.
        least, distance = max(0.0, certificate.min_clearance), outsider.distance(*place.modules)
        assert least - DISTANCE_WITHIN <= distance <= np.sqrt(3.0) * least + DISTANCE_WITHIN
    return count


@pytest.mark.parametrize("name", ALL)
def test_exported_model_agrees_with_the_certificate(name: str, folded: Callable[..., Any]) -> None:
    fold = folded(name)
    xml = (fold.directory / "model.xml").read_text()
    assert check(fold.plan, xml) == QUARTERS * (len(fold.plan.time_s) - 1) + 1
    asked = read((SHAPES / f"{name}.json").read_bytes())
    if isinstance(asked, Path):  # the last configuration is the shape that was asked for
        frames = fold.plan.whole()
        last = frames.joint_angles_rad[-1], frames.root_position[-1], frames.root_wxyz[-1]
        positions = fold.chain.poses(*last).positions
        assert aligned_distances(positions, asked.cells.astype(float)).max() < POSES_WITHIN


def test_peeled_chain_in_pieces_agrees_with_the_certificate(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mjcf, "MAX_TREE_MODULES", 64)
    box = write_chain(snake((4, 4, 5)))
    plan = made(tmp_path, box, strategy="peel", module_size=0.98)
    assert (plan.explosion or {})["strategy"] == "peel"
    xml = (tmp_path / "model.xml").read_text()
    assert xml.count("<freejoint") + xml.count('type="free"') > 1
    assert check(plan, xml) > QUARTERS * 50


def test_replay_refutes_forged_plans_and_models(folded: Callable[..., Any]) -> None:
    """A frame in which modules pass through each other, and a model of larger modules."""
    fold = folded("wrench-24")
    xml = (fold.directory / "model.xml").read_text()
    angles = fold.plan.joint_angles_rad.copy()
    angles[60] = np.tile([np.pi / 2, 0.0], 22)
    with pytest.raises(AssertionError):
        check(changed(fold.plan, joint_angles_rad=angles), xml)
    larger = mjcf.mjcf(fold.plan.chain, module_size=1.02)
    with pytest.raises(AssertionError):
        check(fold.plan, larger)
