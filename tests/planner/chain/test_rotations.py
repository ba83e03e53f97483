from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from planner.chain.rotations import (
    aligned_distances,
    matrix_from_wxyz,
    motion_in_plane,
    wxyz_from_matrix,
)
from tests.planner.chains import random_rotation
from tests.planner.lattice import ROTATIONS

quaternions = (
    arrays(np.float64, (5, 4), elements=st.floats(-1, 1))
    .filter(lambda q: bool((np.linalg.norm(q, axis=1) > 0.1).all()))
    .map(lambda q: q / np.linalg.norm(q, axis=1, keepdims=True))
)


@given(quaternions)
def test_quaternion_comes_back_from_its_matrix(q: np.ndarray) -> None:
    back = wxyz_from_matrix(matrix_from_wxyz(q))
    np.testing.assert_allclose(np.abs((back * q).sum(axis=1)), 1.0, atol=1e-12)
    assert (back[:, 0] >= 0).all()
    np.testing.assert_allclose(matrix_from_wxyz(3.0 * q), matrix_from_wxyz(q), atol=1e-12)


def test_quarter_turns() -> None:
    half = np.sqrt(0.5)
    turned = matrix_from_wxyz(np.array([half, 0.0, 0.0, half])) @ [1.0, 0.0, 0.0]
    np.testing.assert_allclose(turned, [0.0, 1.0, 0.0], atol=1e-15)
    matrices = np.array(ROTATIONS, dtype=np.float64).reshape(2, 12, 3, 3)
    again = matrix_from_wxyz(wxyz_from_matrix(matrices))
    np.testing.assert_allclose(again, matrices, atol=1e-15)


def test_motion_in_plane_leaves_heights_alone() -> None:
    draws = np.random.default_rng(3)
    points = draws.normal(size=(6, 9, 3))
    angles = draws.uniform(-np.pi, np.pi, 6)
    still = np.zeros(6)
    turns = matrix_from_wxyz(
        np.column_stack([np.cos(angles / 2), still, still, np.sin(angles / 2)])
    )
    away = np.column_stack([draws.normal(size=(6, 2)), still])
    target = points @ turns.swapaxes(1, 2) + away[:, None]
    found, shifts = motion_in_plane(points, target + [0.0, 0.0, 2.0])
    np.testing.assert_allclose(found, turns, atol=1e-12)
    np.testing.assert_allclose(shifts, away, atol=1e-12)


@given(st.integers(0, 2**32 - 1))
def test_aligned_distances_are_the_smallest(seed: int) -> None:
    rng = np.random.default_rng(seed)
    target, points = rng.normal(size=(2, 12, 3))
    moved = target @ random_rotation(rng).T + rng.normal(size=3) * 10.0
    np.testing.assert_allclose(aligned_distances(moved, target), 0.0, atol=1e-9)
    assert aligned_distances(target * [1.0, 1.0, -1.0], target).max() > 0.1  # mirrored
    best = (aligned_distances(points, target) ** 2).sum()
    moved = points - points.mean(axis=0)
    fixed = target - target.mean(axis=0)
    for _ in range(20):
        other = ((moved @ random_rotation(rng) - fixed) ** 2).sum()
        assert best <= other + 1e-9


def test_points_in_a_line_are_aligned() -> None:
    straight = np.stack([np.arange(9.0), np.zeros(9), np.zeros(9)], axis=1)
    rotation = random_rotation(np.random.default_rng(3))
    distances = aligned_distances(straight @ rotation.T, straight)
    np.testing.assert_allclose(distances, 0.0, atol=1e-9)
