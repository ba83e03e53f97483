"""Modules of a long chain that are drawn."""

import numpy as np

from foldback.planner.chain.built_in_modules import CUBE, TETRAHEDRON
from foldback.web.pictures.visible_modules import MAX_FULLY_DRAWN_MODULES, visible_modules

BOX = np.stack(np.meshgrid(*[np.arange(20.0)] * 3), axis=-1).reshape(-1, 3)


def test_only_the_surface_of_a_large_box_is_drawn() -> None:
    drawn = visible_modules(BOX, CUBE, target=BOX.mean(axis=0))
    surface = ((BOX == 0) | (BOX == 19)).any(axis=1)
    assert np.array_equal(drawn, np.flatnonzero(surface))
    # If there are fewer modules, all are drawn.
    assert len(visible_modules(BOX[:1000], CUBE, target=BOX[0])) == 1000


def test_only_the_closest_modules_of_a_long_rod_are_drawn() -> None:
    rod = np.arange(10_000.0)[:, None] * [1.0, 0.0, 0.0]
    drawn = visible_modules(rod, TETRAHEDRON, target=np.array([5000.0, 0, 0]))
    assert len(drawn) == MAX_FULLY_DRAWN_MODULES
    assert (np.diff(drawn) == 1).all()
    assert abs(drawn.mean() - 5000) < 1
