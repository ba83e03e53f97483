"""Motion derivatives and their bounds, compared with finite differences of the motion."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foldback.planner.chain.built_in_modules import CUBE, TETRAHEDRON
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.chain.module import Module
from foldback.planner.core import (
    BODY_COLUMNS,
    DISPLACEMENT_BOUND,
    RELATIVE_COLUMNS,
    ROTATION,
    VELOCITY,
    directional_motion_bound,
    move_bodies,
    relative_motion_bound,
    rod_body,
)
from tests.planner.chains import Array

MODULES = st.sampled_from([CUBE, TETRAHEDRON])


def bodies_of(module: Module, angles: Array, rates: Array, half: float, root: int) -> Array:
    count = len(angles) // module.hinges_per_joint + 1 + module.rigid_links
    bodies = np.zeros((count, BODY_COLUMNS))
    bodies[root, ROTATION:VELOCITY] = np.eye(3).ravel()
    move_bodies(angles, rates, half, module.joint, root, bodies)
    return bodies


def motion(
    module: Module, count: int, seed: int, step: float, root: float
) -> tuple[Array, Array, int]:
    """Return angles, rates and a root anywhere along the chain."""
    rng = np.random.default_rng(seed)
    hinges = len(module.joint_names(count))
    # some hinges are at rest
    rates = rng.uniform(-step, step, hinges) * rng.integers(0, 2, hinges)
    return rng.uniform(-1.5, 1.5, hinges), rates, int(root * (count - 1))


@pytest.mark.slow
@given(
    MODULES,
    st.integers(3, 14),
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.02, 0.1, 0.5, 2.0]),
    st.sampled_from([0.5, 0.25, 0.03]),
    st.floats(0.0, 1.0),
)
def test_motion_bounds_hold_for_all_corners(
    module: Module, count: int, seed: int, step: float, half: float, at: float
) -> None:
    angles, rates, root = motion(module, count, seed, step, at)
    bodies = bodies_of(module, angles, rates, half, root)
    moments = np.linspace(-half, half, 21)[:, None]
    poses = forward_kinematics(module, angles + moments * rates, root=root)
    ways = np.linalg.norm(poses.positions - bodies[:, :3], axis=-1).max(axis=0)
    assert (ways <= bodies[:, DISPLACEMENT_BOUND] + 1e-9).all()
    radius = 0.95 * module.radius
    corners = 0.95 * module.pieces[0].corners
    rng = np.random.default_rng(seed)
    relative_row = np.empty(RELATIVE_COLUMNS)
    for i in range(count):
        for j in range(i + 1, count):
            lose, distance = relative_motion_bound(
                bodies[i], bodies[j], half, radius, float(j - i), relative_row
            )
            assert distance == pytest.approx(np.linalg.norm(bodies[j, :3] - bodies[i, :3]))
            gap = poses.positions[:, j] - poses.positions[:, i]
            body_row = np.einsum(
                "fba,fcb->fca",
                poses.rotations[:, i],
                gap[:, None] + corners @ poses.rotations[:, j].swapaxes(1, 2),
            )
            # in world axes at the interval's midpoint, as for the plane's normal
            way = (body_row - body_row[10]) @ bodies[i, ROTATION:VELOCITY].reshape(3, 3).T
            assert np.linalg.norm(way, axis=-1).max() <= lose + 1e-9
            axis = rng.normal(size=3)
            axis /= np.linalg.norm(axis)
            assert (
                np.abs(way @ axis).max()
                <= directional_motion_bound(relative_row, axis, half, radius) + 1e-9
            )


@pytest.mark.parametrize("module", [CUBE, TETRAHEDRON], ids=lambda m: m.name)
def test_rod_agrees_with_its_modules_one_by_one(module: Module) -> None:
    angles, rates, _ = motion(module, 12, 3, 0.1, 0.0)
    bent = len(module.joint_names(6))
    angles[bent:] = rates[bent:] = 0.0
    half = 0.5
    bodies = bodies_of(module, angles, rates, half, 0)
    straight = forward_kinematics(module, np.zeros_like(angles))
    moments = np.linspace(-half, half, 21)[:, None]
    poses = forward_kinematics(module, angles + moments * rates)
    body_row = np.empty(BODY_COLUMNS)
    for t in range(1, 7):
        rod_body(
            bodies[5],
            straight.positions[t],
            straight.rotations[t],
            half,
            body_row,
        )
        np.testing.assert_allclose(body_row[:24], bodies[5 + t, :24], atol=1e-12)
        ways = np.linalg.norm(poses.positions[:, 5 + t] - body_row[:3], axis=-1)
        assert ways.max() <= body_row[DISPLACEMENT_BOUND] + 1e-9
