"""Distances to the folded core, kept up to date as it shrinks, compared with those of SciPy."""

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from foldback.planner.explosion.peeling.core import (
    FIELD_PADDING_CELLS,
    MAX_FIELD_CELLS,
    Core,
    distance_at,
    ray_directions,
)
from tests.planner.chains import Array, shuffled


def distances(core: Core, last: int) -> Array:
    """Return the distance field of a core, at most ``MAX_FIELD_CELLS``."""
    solid = np.pad((core.grid >= 0) & (core.grid <= last), FIELD_PADDING_CELLS)
    field = np.asarray(distance_transform_edt(~solid), dtype=np.float64)
    return np.minimum(field, MAX_FIELD_CELLS)


def test_field_follows_a_core_that_shrinks_and_grows_again() -> None:
    core = Core(shuffled((9, 14, 20), 4, seed=1))
    n = len(core.cells)
    for last in (n - 40, n - 41, n - 600, n - 300, 30, 1, 1, 1800):
        field = core.distances(last)
        assert np.array_equal(field.distances, distances(core, last)), last
        assert np.array_equal(field.low, core.cells.min(axis=0) - FIELD_PADDING_CELLS)


def test_extent_is_that_of_the_modules_that_are_left() -> None:
    core = Core(shuffled((5, 4, 6), 4, seed=2))
    for last in (0, 17, len(core.cells) - 1):
        cells = core.cells[: last + 1]
        assert np.array_equal(core.extent(last), [cells.min(axis=0), cells.max(axis=0)])


@pytest.mark.parametrize("seed", range(3))
def test_exit_direction_is_the_best_of_all_rays(seed: int) -> None:
    core, rng = Core(shuffled((6, 7, 8), 4, seed=seed)), np.random.default_rng(seed)
    before = None
    for last in range(len(core.cells) - 3, 3, -29):
        start, field = core.cells[last + 1], core.distances(last)
        centre = core.cells[: last + 1].mean(axis=0)
        radial = (start - centre) / max(float(np.linalg.norm(start - centre)), 1e-9)
        rays = ray_directions()
        along = np.arange(1.0, np.linalg.norm(core.grid.shape) + FIELD_PADDING_CELLS, 0.5)
        distance = distance_at(field, start + rays[:, None, :] * along[None, :, None])
        lack = np.maximum(np.minimum(2.0, 0.7 + 0.5 * along) - distance, 0.0).max(axis=1)
        score = rays @ radial - 3.0 * lack
        score += 0.0 if before is None else 0.5 * (rays @ before)
        direction = core.exit_direction(field, start, last, before)
        assert np.array_equal(direction, rays[score.argmax()])
        before = direction if rng.uniform() < 0.7 else None
