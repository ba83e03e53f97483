from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from web.pictures.camera import distance_needed
from web.pictures.camera_path import CameraPath, camera_path

FPS = 30.0
ASPECT = 16 / 9
RADIUS = 0.87


def folding(count: int = 90) -> list[np.ndarray]:
    """A chain along x that draws itself together into a short one."""
    line = np.linspace(-0.5, 0.5, 40)
    spans = np.interp(np.arange(count), [count / 3, 2 * count / 3], [40.0, 6.0])
    return [np.column_stack([line * span, 0 * line, np.sin(9 * line)]) for span in spans]


def path_of(pictures: list[np.ndarray], **options: Any) -> CameraPath:
    given = {"azimuth_rad": None, "elevation_rad": 0.4, "turn_rad": 0.0, **options}
    lows = np.array([points[:, 2].min() for points in pictures])
    return camera_path(pictures, lows=lows, radius=RADIUS, aspect=ASPECT, fps=FPS, **given)


def test_nothing_is_ever_cut_off() -> None:
    pictures = folding()
    for points, view in zip(pictures, path_of(pictures, turn_rad=1.0).views, strict=True):
        needed = distance_needed(points, view, radius=RADIUS, aspect=ASPECT)
        assert view.distance > 1.05 * needed


def test_it_comes_nearer_and_moves_evenly() -> None:
    views = path_of(folding()).views
    assert views[-1].distance < views[0].distance / 2
    steps = np.diff(np.log([view.distance for view in views]))
    assert np.abs(steps).max() < 0.08
    assert np.abs(np.diff(steps)).max() < 0.01
    assert abs(steps[0]) < 1e-3 and abs(steps[-1]) < 1e-3


def test_backwards_in_time_it_is_the_same() -> None:
    pictures = folding()
    there, back = path_of(pictures), path_of(pictures[::-1])
    for one, other in zip(there.views, back.views[::-1], strict=True):
        assert one.position == pytest.approx(other.position, abs=1e-9)
    assert there.grounds == pytest.approx(back.grounds[::-1])


def test_it_ends_in_the_direction_asked_for_after_the_turn_asked_for() -> None:
    views = path_of(folding(), azimuth_rad=0.3, turn_rad=-2.0).views
    assert views[-1].azimuth_rad == pytest.approx(0.3)
    assert views[0].azimuth_rad == pytest.approx(2.3)
    assert {view.elevation_rad for view in views} == {0.4}


def test_ground_stays_below_the_chain_and_moves_evenly() -> None:
    pictures = folding()
    for k, points in enumerate(pictures):
        points[:, 2] += -3.0 if 40 <= k < 45 else 0.0
    grounds = path_of(pictures).grounds
    assert all(g < p[:, 2].min() - 0.5 for g, p in zip(grounds, pictures, strict=True))
    assert np.abs(np.diff(grounds)).max() < 0.3


def test_a_single_picture_has_a_camera() -> None:
    path = path_of(folding()[:1], turn_rad=1.0)
    assert len(path.views) == 1 and np.isfinite(path.views[0].position).all()
