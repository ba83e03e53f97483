import numpy as np
import pytest

from planner.pathfinding.shape_overlap import covered_by
from planner.shapes.uncovered_surface import uncovered_surface
from tests.planner.solids_made import box


def test_surface_without_modules_behind_it_is_found() -> None:
    bar = box(6, 2, 2)  # modules fill the half with x < 0
    cells = np.array([[x, y, z] for x in (-3, -2, -1) for y in (-1, 0) for z in (-1, 0)])

    def is_covered(points: np.ndarray) -> np.ndarray:
        return covered_by(cells, points - 0.5)

    missing = uncovered_surface(
        np.asarray(bar.vertices), np.asarray(bar.faces), is_covered, oriented=True
    )
    sides = np.cross(missing[:, 1] - missing[:, 0], missing[:, 2] - missing[:, 0])
    area = 0.5 * np.linalg.norm(sides, axis=1).sum()
    assert area == pytest.approx(3 * 8 + 4, abs=2.0)  # its sides and one end
    assert missing[..., 0].min() > -0.6
    edges = np.linalg.norm(np.roll(missing, -1, axis=1) - missing, axis=2)
    assert edges.max() < 0.51
    whole = uncovered_surface(
        np.asarray(bar.vertices),
        np.asarray(bar.faces),
        lambda points: points[:, 0] < 9,
        oriented=True,
    )
    assert not len(whole)
