from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from planner.chain.rotations import aligned_distances
from tests.planner.chains import random_rotation


@given(st.integers(0, 2**32 - 1), st.integers(3, 40))
def test_a_rigid_motion_leaves_no_distance(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    target = rng.normal(size=(count, 3)) * 5.0
    points = target @ random_rotation(rng).T + rng.normal(size=3) * 10.0
    np.testing.assert_allclose(aligned_distances(points, target), 0.0, atol=1e-9)


def test_a_mirror_image_is_not_the_same() -> None:
    rng = np.random.default_rng(0)
    target = rng.normal(size=(20, 3))
    assert aligned_distances(target * [1.0, 1.0, -1.0], target).max() > 0.5


@given(st.integers(0, 2**32 - 1))
def test_no_other_motion_does_better(seed: int) -> None:
    rng = np.random.default_rng(seed)
    target, points = rng.normal(size=(2, 12, 3))
    best = (aligned_distances(points, target) ** 2).sum()
    moved = points - points.mean(axis=0)
    fixed = target - target.mean(axis=0)
    for _ in range(20):
        other = ((moved @ random_rotation(rng) - fixed) ** 2).sum()
        assert best <= other + 1e-9


def test_points_in_a_line_or_a_plane_align_as_well() -> None:
    straight = np.stack([np.arange(9.0), np.zeros(9), np.zeros(9)], axis=1)
    rotation = random_rotation(np.random.default_rng(3))
    distances = aligned_distances(straight @ rotation.T, straight)
    np.testing.assert_allclose(distances, 0.0, atol=1e-9)


def test_one_module_out_of_place_shows() -> None:
    rng = np.random.default_rng(1)
    target = rng.normal(size=(200, 3)) * 5.0
    points = target.copy()
    points[7] += [0.5, 0.0, 0.0]
    distances = aligned_distances(points, target)
    assert int(np.argmax(distances)) == 7
    assert distances[7] > 0.49
