import numpy as np
import pytest

from foldback.planner.core import chain_inverse_step_limit, near_pairs
from foldback.planner.core.structures import ChainLimits, PairLimits
from foldback.planner.simulation.mujoco_models import Material
from foldback.planner.simulation.segments import Segments
from tests.planner.chains import Array, line, random_state


def random_walk(count: int, seed: int, stiffness: float) -> Array:
    """Return points at unit distance, each in a random direction from the previous one."""
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


@pytest.mark.slow
@pytest.mark.parametrize("maximum", [200, 1300])
def test_all_pairs_are_found(maximum: int) -> None:
    for seed in range(30 if maximum == 200 else 3):
        rng = np.random.default_rng(seed)
        cutoff, apart = rng.uniform(0.5, 5.0), int(rng.integers(1, 6))
        points = random_walk(maximum - int(rng.integers(0, 149)), seed, rng.uniform(0.0, 3.0))
        near = near_pairs(points, cutoff, apart).tolist()
        assert {(i, j) for i, j in near} == all_pairs(points, cutoff, apart)
        assert len(near) == len({(i, j) for i, j in near})


@pytest.mark.parametrize("count", [10, 1100])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e200])
def test_point_that_is_not_finite_has_no_pairs_and_hides_none(count: int, bad: float) -> None:
    points = random_walk(count, 1, 0.0)
    sound = all_pairs(points, 2.5, 2)
    points[4] = bad
    near_indices = {(i, j) for i, j in near_pairs(points, 2.5, 2).tolist()}
    # A search may skip points that are unreachable from a distant point, but not from a NaN.
    assert near_indices == {module_pair for module_pair in sound if 4 not in module_pair}


def test_step_limit_bounds_the_speed_of_all_surface_points() -> None:
    chain = line(20)
    segments = Segments(chain, Material())
    for seed in range(10):
        state = random_state(chain, seed, maximum=1.5)
        segments.place(state)
        pairs = near_pairs(segments.positions, 2.5, 2)
        radius = chain.module.radius
        pair_limits = PairLimits(radius, 1.0, 1.0)
        limits = ChainLimits(np.inf, np.inf, 0.0, pair_limits, pair_limits)
        limit = chain_inverse_step_limit(state.reduced, segments.modules, pairs, limits)
        # Corners of each relative to the other's centre, in a frame that rotates at their mean
        # rate.
        for i, j in [*pairs.tolist(), *pairs[:, ::-1].tolist()]:
            corners = chain.module.pieces[0].corners @ segments.rotations[j].T
            places = segments.positions[j] + corners
            speeds = segments.velocities[j] + np.cross(segments.spins[j], corners)
            turning = 0.5 * (segments.spins[i] + segments.spins[j])
            speed_differences = speeds - segments.velocities[i]
            speed_differences -= np.cross(turning, places - segments.positions[i])
            distance = np.linalg.norm(segments.positions[j] - segments.positions[i])
            allowed = 1.0 + 0.5 * max(distance - 2.0 * radius, 0.0)
            assert np.linalg.norm(speed_differences, axis=1).max() <= limit * allowed + 1e-9
