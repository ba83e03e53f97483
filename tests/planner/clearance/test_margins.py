"""Margins: disturbed motions within them are proved clear, and the lemmas hold in NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from foldback.planner.chain.built_in_modules import CUBE, TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.chain.module import Module
from foldback.planner.clearance.margins import (
    FAILURE_PROBABILITY,
    Margin,
    Margins,
    margins,
    unproved_margins,
)
from foldback.planner.clearance.sweep import disturbed_sweep, pair_clearance, sweep
from foldback.planner.core.structures import Tolerance
from foldback.planner.motion.motion import Motion, as_motion
from tests.planner.chains import Array, coil
from tests.planner.clearance.test_proof import random_chain
from tests.planner.peels import peel

SIZE = 0.8
Folding = tuple[Chain, Motion, Margins]


@pytest.fixture(scope="module")
def folding() -> Folding:
    chain = coil(24)
    motion = peel(chain, width=4, step=0.5)
    found_margins = margins(chain, motion, sweep(chain, motion, module_size=SIZE), module_size=SIZE)
    assert found_margins is not None
    return chain, motion, found_margins


def _is_clear(chain: Chain, angles: Array, size: float = SIZE) -> bool:
    return sweep(chain, angles, module_size=size, share=0.0).bound > 0.0


def test_motion_with_one_hinge_off_by_the_margin_is_clear(folding: Folding) -> None:
    chain, motion, found_margins = folding
    angles = motion.angles(chain)
    off = found_margins.one_hinge_rad.value
    assert off > np.radians(0.1)
    for hinge in range(angles.shape[1]):
        for sign in (-1.0, 1.0):
            disturbed = angles.copy()
            disturbed[:, hinge] += sign * off
            assert _is_clear(chain, disturbed), hinge


def test_motion_with_random_errors_within_the_margin_is_clear(folding: Folding) -> None:
    chain, motion, found_margins = folding
    angles, rng = motion.angles(chain), np.random.default_rng(1)
    off = found_margins.independent_rad.value
    assert 0.0 < off < found_margins.one_hinge_rad.value
    for _ in range(20):
        assert _is_clear(chain, angles + rng.uniform(-off, off, angles.shape[1]))


def test_margins_that_are_too_large_are_not_proved(folding: Folding) -> None:
    chain, motion, found_margins = folding
    assert unproved_margins(chain, motion, found_margins, module_size=SIZE) == []
    for name in ("module_size", "one_hinge_rad", "independent_rad"):
        margin: Margin = getattr(found_margins, name)
        forged = replace(found_margins, **{name: replace(margin, value=1.3 * margin.value)})
        assert unproved_margins(chain, motion, forged, module_size=SIZE) == [name]
    sure = replace(found_margins, failure_probability=FAILURE_PROBABILITY / 1e6)
    assert unproved_margins(chain, motion, sure, module_size=SIZE) == ["independent_rad"]


def _allowance(module: Module, x: Array, pair: tuple[int, int], errors: Tolerance) -> float:
    """Return the allowance of lemmas 11 and 12, computed in NumPy."""
    (i, j), (one_error, each_error, kappa, spare) = pair, errors
    arm = module.radius * SIZE + float(np.linalg.norm(module.joint.anchor[0]))
    from_i, from_j = (np.linalg.norm(x[i:j] - x[k], axis=1) + arm for k in (i, j))
    lever = np.repeat(from_j, module.hinges_per_joint)
    moved = each_error * lever.sum() / (1.0 - each_error * len(lever))
    spread = np.sqrt(((lever + moved) ** 2).sum())
    drift = 0.5 * each_error * each_error * (lever + moved).sum()
    return float(
        spare + one_error * np.minimum(from_i, from_j).max() + each_error * kappa * spread + drift
    )


@pytest.mark.parametrize("module", [CUBE, TETRAHEDRON], ids=lambda module: module.name)
def test_one_frame_leaves_the_clearance_less_the_allowance(module: Module) -> None:
    rng, errors = np.random.default_rng(2), Tolerance(0.02, 1e-3, 6.0, 1e-6)
    for _ in range(8):
        chain = random_chain(module, 24, rng)
        angles = chain.folded_rad
        poses = forward_kinematics(module, angles)
        least_clearance = min(
            pair_clearance(module, poses, (i, j), module_size=SIZE)
            - _allowance(module, poses.positions, (i, j), errors)
            for i in range(24)
            for j in range(i + module.apart, 24)
        )
        disturbed = disturbed_sweep(chain, as_motion(angles[None]), errors, module_size=SIZE)
        assert disturbed.clearance == pytest.approx(min(least_clearance, 1e-3), abs=1e-9)
