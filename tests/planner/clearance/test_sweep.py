import numpy as np
import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.clearance.clearance import closest
from foldback.planner.clearance.sweep import (
    CLEARANCE_CAP,
    EXTENDED_CLEARANCE_CAP,
    clearance_at,
    closest_at_frames,
    sweep,
)
from foldback.planner.motion.motion import as_motion
from tests.planner.chains import Array, coil, line
from tests.planner.peels import peel, snake


def clearance_of(chain: Chain, angles: Array, size: float) -> float:
    poses = forward_kinematics(chain.module, angles, root=chain.root)
    place = closest(
        chain.module,
        poses.positions,
        poses.rotations,
        module_size=size,
        enough=EXTENDED_CLEARANCE_CAP,
    )
    return place.clearance


def sampled_clearance(chain: Chain, frames: Array, size: float, samples: int) -> float:
    """Return the minimum clearance at evenly spaced instants of a motion, without any bound."""
    clearance = EXTENDED_CLEARANCE_CAP
    for a, b in zip(frames[:-1], frames[1:], strict=True):
        for s in np.linspace(0.0, 1.0, samples):
            clearance = min(clearance, clearance_of(chain, (1.0 - s) * a + s * b, size))
    return clearance


def test_collision_between_two_clear_frames_is_found() -> None:
    chain, frames = crossing()
    size = 0.95
    assert clearance_of(chain, frames[0], size) > 0.0
    assert clearance_of(chain, frames[1], size) > 0.0
    swept = sweep(chain, frames, module_size=size)
    assert swept.clearance < 0.0
    assert swept.frame not in (0.0, 1.0)
    assert swept.modules is not None
    assert swept.bound <= 0.0
    at = (1.0 - swept.frame) * frames[0] + swept.frame * frames[1]
    assert clearance_of(chain, at, size) == pytest.approx(swept.clearance, abs=1e-9)


def crossing() -> tuple[Chain, Array]:
    """Return two clear frames between which a chain passes through itself, found by sampling."""
    chain = line(8)
    rng = np.random.default_rng(0)
    while True:
        frames = rng.uniform(-1.5, 1.5, (2, len(chain.folded_rad)))
        if min(clearance_of(chain, f, 0.95) for f in frames) < 0.05:
            continue
        if clearance_of(chain, frames.mean(axis=0), 0.95) < 0.0:
            continue
        if sampled_clearance(chain, frames, 0.95, 60) < -0.05:
            return chain, frames


def test_bound_holds_for_chains_whose_ends_swing_far() -> None:
    chain = line(90)
    outcomes = set()
    for seed in range(20):
        rng = np.random.default_rng(seed)
        start = rng.normal(0.0, 0.25, len(chain.folded_rad))
        frames = np.stack([start, start + rng.normal(0.0, 0.3, len(start))])
        poses = [forward_kinematics(chain.module, q, root=chain.root).positions for q in frames]
        assert np.linalg.norm(poses[1] - poses[0], axis=1).max() > 2.0
        if clearance_of(chain, frames[0], 0.95) < 0.0 or clearance_of(chain, frames[1], 0.95) < 0.0:
            continue
        swept = sweep(chain, frames, module_size=0.95)
        dense = sampled_clearance(chain, frames, 0.95, 81)
        assert swept.unbounded is None or swept.clearance <= 0.0
        if dense < -1e-3:
            assert swept.clearance < 0.0
        if swept.clearance >= 0.0:
            assert 0.0 < swept.bound <= dense + 1e-9
        outcomes.add(swept.clearance < 0.0)
    assert outcomes == {True, False}


def test_cancelled_sweep_covers_nothing_more() -> None:
    chain = coil(12)
    motion = as_motion(chain.folded_rad[None])
    for frames in (motion, motion.windowed(chain)):
        swept = sweep(chain, frames, module_size=1.5, cancelled=lambda: True)
        assert swept.in_betweens == 0
        assert swept.clearance == CLEARANCE_CAP


@pytest.mark.parametrize("windowed", [False, True])
def test_closest_frame_is_that_of_the_sweep_without_what_is_between(windowed: bool) -> None:
    chain = snake((3, 4, 5))
    motion = peel(chain, width=18, step=1.5)
    motion = motion if windowed else motion.dense(chain)
    swept = sweep(chain, motion, module_size=0.6)
    closest = closest_at_frames(chain, motion, module_size=0.6)
    assert closest.clearance == swept.per_frame.min()
    assert closest.frame == swept.per_frame.argmin()
    assert closest.modules is not None
    clearance = clearance_at(chain, motion, closest.frame, closest.modules, module_size=0.6)
    assert clearance == pytest.approx(closest.clearance, abs=1e-12)


def test_closest_frame_of_a_motion_far_from_itself_is_found_beyond_the_usual_cutoff() -> None:
    chain = line(4)
    motion = as_motion(np.zeros((2, len(chain.folded_rad))))
    closest = closest_at_frames(chain, motion, module_size=0.5)
    assert closest.clearance == pytest.approx(1.5)
    assert closest.modules in {(0, 2), (1, 3)}
