from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from planner.kernels import pairs as module
from planner.kernels.module import ModuleStates
from planner.kernels.pairs import PairLimits, max_inverse_step_limit, near_pairs, repulsion
from planner.simulation.model import Material
from planner.simulation.segments import Segments
from tests.conftest import examples
from tests.planner.chains import line, random_state

Array = NDArray[np.float64]


def wandering(count: int, seed: int, stiffness: float) -> Array:
    """Points one apart, each a random turn from the last."""
    rng = np.random.default_rng(seed)
    steps = np.empty((count, 3))
    step = np.array([1.0, 0.0, 0.0])
    for i in range(count):
        step = stiffness * step + rng.normal(size=3)
        step /= np.linalg.norm(step)
        steps[i] = step
    return np.cumsum(steps, axis=0)


def all_pairs(points: Array, cutoff: float, apart: int) -> set[tuple[int, int]]:
    gaps = np.linalg.norm(points[:, None] - points[None], axis=-1)
    first, second = np.nonzero(gaps < cutoff)
    return {(i, j) for i, j in zip(first.tolist(), second.tolist(), strict=True) if j >= i + apart}


@given(
    st.integers(2, 150),
    st.integers(0, 2**32 - 1),
    st.floats(0.0, 3.0),
    st.floats(0.3, 6.0),
    st.integers(1, 5),
)
def test_walking_finds_all_pairs(
    count: int, seed: int, stiffness: float, cutoff: float, apart: int
) -> None:
    points = wandering(count, seed, stiffness)
    found = near_pairs(points, cutoff, apart).tolist()
    assert {(i, j) for i, j in found} == all_pairs(points, cutoff, apart)
    assert len(found) == len({(i, j) for i, j in found})


@pytest.mark.slow
@examples(one_of=10)
@given(st.integers(1000, 1300), st.integers(0, 2**32 - 1), st.floats(0.0, 3.0), st.floats(0.8, 4.0))
def test_grid_finds_all_pairs(count: int, seed: int, stiffness: float, cutoff: float) -> None:
    assert count >= module.MIN_GRID_POINTS
    points = wandering(count, seed, stiffness)
    found = near_pairs(points, cutoff, 2).tolist()
    assert {(i, j) for i, j in found} == all_pairs(points, cutoff, 2)
    assert len(found) == len({(i, j) for i, j in found})


def test_more_pairs_than_expected_are_kept() -> None:
    points = np.zeros((60, 3))
    assert len(near_pairs(points, 1.0, 1)) == 60 * 59 // 2


@pytest.mark.parametrize("count", [10, 1100])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e200])
def test_point_that_is_not_finite_has_no_pairs_and_hides_none(count: int, bad: float) -> None:
    points = wandering(count, 1, 0.0)
    sound = all_pairs(points, 2.5, 2)
    points[4] = bad
    found = {(i, j) for i, j in near_pairs(points, 2.5, 2).tolist()}
    # Walking from a far point skips what it cannot reach; from a lost one it must not.
    assert found == {pair for pair in sound if 4 not in pair}


@given(st.floats(0.05, 5.0), st.floats(0.1, 10.0), st.integers(0, 2**32 - 1))
def test_points_repel_with_the_gain_over_the_square(
    distance: float, gain: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    away = rng.normal(size=3)
    away /= np.linalg.norm(away)
    points = np.stack([np.ones(3), np.ones(3) + distance * away])
    forces = np.zeros((2, 3))
    repulsion(points, np.array([[0, 1]]), gain, forces)
    np.testing.assert_allclose(forces[1], gain / distance**2 * away, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(forces[0], -forces[1])


def test_step_limit_bounds_the_speed_of_all_surface_points() -> None:
    chain = line(20)
    segments = Segments(chain, Material())
    for seed in range(10):
        state = random_state(chain, seed, most=1.5)
        segments.place(state)
        pairs = near_pairs(segments.positions, 2.5, 2)
        radius = chain.module.radius
        said = max_inverse_step_limit(segments.modules, pairs, PairLimits(radius, 1.0, 1.0))
        # Corners of each seen from the other's centre, in a frame that turns as both do on average.
        for i, j in [*pairs.tolist(), *pairs[:, ::-1].tolist()]:
            corners = chain.module.vertices @ segments.rotations[j].T
            places = segments.positions[j] + corners
            speeds = segments.velocities[j] + np.cross(segments.spins[j], corners)
            turning = 0.5 * (segments.spins[i] + segments.spins[j])
            seen = speeds - segments.velocities[i]
            seen -= np.cross(turning, places - segments.positions[i])
            distance = np.linalg.norm(segments.positions[j] - segments.positions[i])
            allowed = 1.0 + 0.5 * max(distance - 2.0 * radius, 0.0)
            assert np.linalg.norm(seen, axis=1).max() <= said * allowed + 1e-9


def test_step_limit_of_modules_that_spin() -> None:
    points, spins = np.array([[0.0, 0, 0], [1.5, 0, 0]]), np.array([[0.0, 0, 1], [0.0, 0, -1]])
    modules = ModuleStates(points, np.zeros((2, 3, 3)), np.zeros((2, 3)), spins)
    said = max_inverse_step_limit(modules, np.array([[0, 1]]), PairLimits(0.8, 0.5, 1.0))
    assert said == pytest.approx(2.0 * 0.8 / 0.5)


@pytest.mark.parametrize(
    ("velocity", "said"),
    [
        ([-0.1, 0.0, 0.0], 0.1 / 0.02),  # nearer: by ``approach`` in a step
        ([0.1, 0.0, 0.0], 0.1 / 0.2),  # farther
        ([0.0, 0.1, 0.0], 0.1 / 0.2),  # along each other: by ``slide``
    ],
)
def test_step_limit_of_modules_that_approach_or_slide(velocity: list[float], said: float) -> None:
    points, still = np.array([[0.0, 0, 0], [1.0, 0, 0]]), np.zeros((2, 3))
    moving, pair = np.array([[0.0, 0, 0], velocity]), np.array([[0, 1]])
    modules = ModuleStates(points, np.zeros((2, 3, 3)), moving, still)
    found = max_inverse_step_limit(modules, pair, PairLimits(0.8, 0.02, 0.2))
    assert found == pytest.approx(said)
