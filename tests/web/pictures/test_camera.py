"""Cameras of single pictures, and along a movie."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foldback.web.pictures.camera import FIELD_OF_VIEW_RAD, View, distance_needed, framing
from foldback.web.pictures.camera_path import CameraPath, camera_path

RADIUS = 0.87


def project(points: np.ndarray, view: View, aspect: float) -> np.ndarray:
    """Return (n, 2) positions in the picture, from −1 to 1 inside it."""
    out = (view.position - view.target) / view.distance
    right = np.cross([0.0, 0.0, 1.0], out)
    right /= np.linalg.norm(right)
    up = np.cross(out, right)
    off = points - view.position
    depth = -(off @ out)
    assert (depth > 0).all()
    tall = np.tan(FIELD_OF_VIEW_RAD / 2)
    return np.column_stack([off @ right / depth / (tall * aspect), off @ up / depth / tall])


points = st.lists(
    st.tuples(*[st.floats(-80, 80, allow_nan=False)] * 3), min_size=1, max_size=40
).map(lambda rows: np.array(rows, dtype=float))


@given(points, st.sampled_from([0.46, 1.0, 1.6, 2.2]))
def test_framing_shows_every_module(cells: np.ndarray, aspect: float) -> None:
    view = framing(cells, radius=RADIUS, aspect=aspect)
    assert np.abs(project(cells, view, aspect)).max() <= 1.0


def test_long_chain_fills_the_width_in_any_direction() -> None:
    for turn in np.linspace(0, np.pi, 7):
        line = np.arange(-80, 81)[:, None] * [np.cos(turn), np.sin(turn), 0.0]
        assert np.ptp(project(line, framing(line, radius=RADIUS), 1.6)[:, 0]) > 1.6


def test_camera_distance_is_the_smallest_that_suffices() -> None:
    line = np.arange(-80, 81)[:, None] * [0.5, 0.8, 0.1]
    view = framing(line, radius=0.0, aspect=0.5)
    view = replace(view, target=view.target + [3.0, 1.0, 2.0])
    smallest_distance_needed = distance_needed(line, view, radius=0.0, aspect=0.5)
    assert np.abs(
        project(line, replace(view, distance=smallest_distance_needed), 0.5)
    ).max() == pytest.approx(1.0)


FPS = 30.0
ASPECT = 16 / 9


def folding(count: int = 90) -> list[np.ndarray]:
    """Return frames of a chain along x that contracts into a short one."""
    line = np.linspace(-0.5, 0.5, 40)
    spans = np.interp(np.arange(count), [count / 3, 2 * count / 3], [40.0, 6.0])
    return [np.column_stack([line * span, 0 * line, np.sin(9 * line)]) for span in spans]


def path_of(pictures: list[np.ndarray], **options: Any) -> CameraPath:
    arguments = {"azimuth_rad": None, "elevation_rad": 0.4, "turn_rad": 0.0, **options}
    lows = np.array([points[:, 2].min() for points in pictures])
    return camera_path(pictures, lows=lows, radius=RADIUS, aspect=ASPECT, fps=FPS, **arguments)


def test_no_module_is_cut_off() -> None:
    pictures = folding()
    for points, view in zip(pictures, path_of(pictures, turn_rad=1.0).views, strict=True):
        assert view.distance > 1.05 * distance_needed(points, view, radius=RADIUS, aspect=ASPECT)


def test_camera_approaches_and_moves_evenly() -> None:
    views = path_of(folding()).views
    assert views[-1].distance < views[0].distance / 2
    steps = np.diff(np.log([view.distance for view in views]))
    assert np.abs(steps).max() < 0.08
    assert np.abs(np.diff(steps)).max() < 0.01
    assert abs(steps[0]) < 1e-3 and abs(steps[-1]) < 1e-3


def test_camera_ends_in_the_requested_direction_after_the_requested_turn() -> None:
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
    (view,) = path_of(pictures[:1], turn_rad=1.0).views  # of a single picture
    assert np.isfinite(view.position).all()
