from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from web.pictures.camera import FIELD_OF_VIEW_RAD, View, distance_needed, framing

RADIUS = 0.87


def seen(points: np.ndarray, view: View, aspect: float) -> np.ndarray:
    """(n, 2) places in the picture, from −1 to 1 when inside."""
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
    assert np.abs(seen(cells, view, aspect)).max() <= 1.0


def test_a_long_chain_fills_the_width_whichever_way_it_lies() -> None:
    for turn in np.linspace(0, np.pi, 7):
        line = np.arange(-80, 81)[:, None] * [np.cos(turn), np.sin(turn), 0.0]
        spots = seen(line, framing(line, radius=RADIUS), 1.6)
        assert np.ptp(spots[:, 0]) > 1.6


def test_the_picture_is_centred() -> None:
    box = np.stack(np.meshgrid(range(4), range(4), range(10)), -1).reshape(-1, 3)
    spots = seen(box, framing(box, radius=RADIUS), 1.6)
    middle = (spots.max(axis=0) + spots.min(axis=0)) / 2
    assert np.abs(middle).max() < 0.05


def test_the_distance_needed_is_just_enough() -> None:
    line = np.arange(-80, 81)[:, None] * [0.5, 0.8, 0.1]
    view = framing(line, radius=0.0, aspect=0.5)
    view = replace(view, target=view.target + [3.0, 1.0, 2.0])
    least = distance_needed(line, view, radius=0.0, aspect=0.5)
    assert np.abs(seen(line, replace(view, distance=least), 0.5)).max() == pytest.approx(1.0)
