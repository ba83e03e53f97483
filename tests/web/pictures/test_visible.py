from __future__ import annotations

import numpy as np
import pytest

from planner.chain.module import CUBE, TETRAHEDRON
from web.pictures.visible import MAX_FULLY_DRAWN_MODULES, visible_modules

BOX = np.stack(np.meshgrid(*[np.arange(20.0)] * 3), axis=-1).reshape(-1, 3)


def test_of_a_large_box_the_surface_is_drawn() -> None:
    drawn = visible_modules(BOX, CUBE, target=BOX.mean(axis=0))
    surface = ((BOX == 0) | (BOX == 19)).any(axis=1)
    assert np.array_equal(drawn, np.flatnonzero(surface))
    # Of fewer all are drawn.
    assert len(visible_modules(BOX[:1000], CUBE, target=BOX[0])) == 1000


@pytest.mark.parametrize("module", [CUBE, TETRAHEDRON])
def test_of_a_long_rod_the_nearest_are_drawn(module: object) -> None:
    rod = np.arange(10_000.0)[:, None] * [1.0, 0.0, 0.0]
    drawn = visible_modules(rod, module, target=np.array([5000.0, 0, 0]))  # type: ignore[arg-type]
    assert len(drawn) == MAX_FULLY_DRAWN_MODULES
    assert (np.diff(drawn) == 1).all()
    assert abs(drawn.mean() - 5000) < 1
