"""Moments of a fold: independent computations find the stored frames again."""

import json
from itertools import combinations
from pathlib import Path as FilePath

import numpy as np
import pytest

from foldback.planner.certificate.figures_store import Figures
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import Poses
from foldback.planner.errors import InputError
from foldback.planner.motion.timeline import Timeline, TimelineWriter
from foldback.planner.pathfinding.knots import knot_of
from foldback.planner.pipeline.fold_layout import stored_moments
from foldback.planner.plan.moment_search import moments_of
from foldback.planner.plan.moments import (
    CONTACT_LINKS,
    CONTACT_PITCH,
    MOMENTS_FORMAT,
    Moments,
)
from foldback.planner.storage.file_names import MOMENTS
from tests.planner.chains import anchored, coil, knotted
from tests.planner.clearance.reference import separation
from tests.planner.conftest import Folded


def module_separation(chain: Chain, poses: Poses, size: float, pair: tuple[int, int]) -> float:
    """Return the separation of two modules, as the reference of the sweep computes it."""
    (a, b), hull = pair, chain.module.hull
    offset = poses.positions[b] - poses.positions[a]
    return separation(hull, size, offset, poses.rotations[a], poses.rotations[b])[0]


def min_separation(chain: Chain, poses: Poses, size: float, links: int) -> float:
    """Return the smallest separation of modules at least ``links`` links apart."""
    near = [
        (a, b)
        for a, b in combinations(range(len(chain)), 2)
        if b - a >= links and np.linalg.norm(poses.positions[a] - poses.positions[b]) < 1.9
    ]
    return min((module_separation(chain, poses, size, pair) for pair in near), default=1.0)


def straight_to_folded(directory: FilePath, chain: Chain, frames: int) -> Timeline:
    """Return a timeline in which all hinges rotate at constant rates, regardless of collisions."""
    angles = np.linspace(0.0, 1.0, frames)[:, None] * chain.folded_rad
    with TimelineWriter.create(directory, chain) as writer:
        writer.append(anchored("playback", angles))
    return Timeline.open(directory)


def test_damaged_moments_are_none(tmp_path: FilePath) -> None:
    for text in ("", "[3]", "{}", json.dumps({"format": MOMENTS_FORMAT, "plan": "x"})):
        (tmp_path / MOMENTS).write_text(text)
        assert stored_moments(tmp_path) is None


def test_stored_moments_of_a_fold_have_the_right_frames(folded: Folded) -> None:
    moments, size = stored_moments(folded.directory), folded.plan.certificate.module_size
    assert moments is not None
    timeline = Timeline.open(folded.directory / "timeline")
    assert moments.frames == len(timeline) == moments.plan + len(folded.plan.time_s)
    assert not timeline.frames(moments.straight, moments.straight + 1).joint_angles_rad.any()

    contact = moments.contact
    assert contact is not None
    poses = timeline.frames().poses(folded.chain)

    def at(frame: int) -> Poses:
        return Poses(positions=poses.positions[frame], rotations=poses.rotations[frame])

    assert module_separation(folded.chain, at(contact.frame), size, contact.modules) < CONTACT_PITCH
    for frame in range(moments.straight, contact.frame):
        assert min_separation(folded.chain, at(frame), size, CONTACT_LINKS) >= CONTACT_PITCH

    figures = Figures.load(folded.directory / "figures", moments.plan)
    torques = np.abs(figures.torque_nm)
    frame, hinge = np.unravel_index(torques.argmax(), torques.shape)
    name = folded.chain.joint_names[hinge]
    assert moments.torque is not None
    assert moments.torque.frame == moments.plan + frame
    assert name.startswith(f"joint_{moments.torque.modules[0]}_")
    assert moments.torque.modules[1] == moments.torque.modules[0] + 1


def test_direct_servoing_collides_at_the_stored_moment(tmp_path: FilePath) -> None:
    chain = coil(24)
    moments = moments_of(straight_to_folded(tmp_path, chain, 201), module_size=0.95)
    assert moments is not None and moments.direct is not None and moments.direct_percent
    for percent in range(1, moments.direct_percent + 1):
        poses = chain.poses(percent / 100 * chain.folded_rad, np.zeros(3), np.eye(4)[0])
        overlaps = min_separation(chain, poses, 0.95, chain.module.apart) < 0.0
        assert overlaps == (percent == moments.direct_percent)
    # All hinges rotate at constant rates here as well, in 200 steps.
    assert moments.direct.frame == pytest.approx(2 * moments.direct_percent, abs=1)


def test_chain_becomes_a_knot_at_the_stored_moment(tmp_path: FilePath) -> None:
    chain = knotted(1)
    timeline = straight_to_folded(tmp_path, chain, 41)
    moments = moments_of(timeline, module_size=0.95, direct=False)
    assert moments is not None and moments.knot is not None
    before, after = timeline.frames(moments.knot - 1, moments.knot + 1).poses(chain).positions
    assert (knot_of(before).verdict, knot_of(after).verdict) == ("unknot", "knotted")
    assert moments.determinant == 3
    values = json.loads(json.dumps(moments.as_dict()))
    assert Moments.from_dict(values) == moments
    with pytest.raises(InputError, match="foldback-moments/1"):
        Moments.from_dict({**values, "format": "foldback-moments/0"})
