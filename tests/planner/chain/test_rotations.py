from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from planner.chain.rotations import matrix_from_wxyz, motion_in_plane, wxyz_from_matrix
from tests.planner.lattice import ROTATIONS

quaternions = (
    arrays(np.float64, (5, 4), elements=st.floats(-1, 1))
    .filter(lambda q: bool((np.linalg.norm(q, axis=1) > 0.1).all()))
    .map(lambda q: q / np.linalg.norm(q, axis=1, keepdims=True))
)


@given(quaternions)
def test_a_quaternion_comes_back_from_its_matrix_up_to_sign(q: np.ndarray) -> None:
    back = wxyz_from_matrix(matrix_from_wxyz(q))
    np.testing.assert_allclose(np.abs((back * q).sum(axis=1)), 1.0, atol=1e-12)
    assert (back[:, 0] >= 0).all()


@given(quaternions)
def test_matrices_are_rotations(q: np.ndarray) -> None:
    m = matrix_from_wxyz(q)
    np.testing.assert_allclose(
        m @ m.swapaxes(-1, -2), np.broadcast_to(np.eye(3), m.shape), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(m), 1.0, atol=1e-12)


@given(quaternions)
def test_the_length_of_a_quaternion_does_not_matter(q: np.ndarray) -> None:
    np.testing.assert_allclose(matrix_from_wxyz(3.0 * q), matrix_from_wxyz(q), atol=1e-12)


@pytest.mark.parametrize("rotation", ROTATIONS)
def test_half_and_quarter_turns_survive(rotation: np.ndarray) -> None:
    matrix = rotation.astype(np.float64)
    np.testing.assert_allclose(matrix_from_wxyz(wxyz_from_matrix(matrix)), matrix, atol=1e-15)


def test_a_quarter_turn_about_z_takes_x_to_y() -> None:
    half = np.sqrt(0.5)
    turned = matrix_from_wxyz(np.array([half, 0.0, 0.0, half])) @ [1.0, 0.0, 0.0]
    np.testing.assert_allclose(turned, [0.0, 1.0, 0.0], atol=1e-15)


def test_leading_axes_are_kept() -> None:
    q = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (2, 3, 4))
    assert matrix_from_wxyz(q).shape == (2, 3, 3, 3)
    assert wxyz_from_matrix(matrix_from_wxyz(q)).shape == (2, 3, 4)


def test_a_motion_along_a_table_is_found_and_leaves_heights_alone() -> None:
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
