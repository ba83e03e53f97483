"""The moment and the camera of a link, and what is written into its picture."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from planner.chain.chain import Chain
from planner.chain.path import Path as CellPath
from web.pictures.camera import View
from web.pictures.caption import FAILED_RGB, Caption, write_caption
from web.pictures.picture_view import MIN_FOLLOW_ZOOM, PictureView
from web.pictures.social_picture import SOCIAL_PICTURE_PX, Moment, social_picture

POINTS = np.array([[0.0, 0, 0], [5, 0, 0], [5, 3, 0], [5, 3, 2]])
CHAIN = Chain.from_path(CellPath.from_cells([(0, 0, 0), (1, 0, 0), (1, 1, 0), (2, 1, 0)]))


def camera(view: PictureView) -> View:
    return view.camera(POINTS, radius=0.9, aspect=1.9, margin=(0.8, 0.6))


def test_short_form_names_frame_and_camera() -> None:
    assert PictureView.from_short("12,,,1") == PictureView(frame=11)
    view = PictureView.from_short("1,-90,45.5,1.25,0.1,-0.2")
    assert view.azimuth_rad == pytest.approx(-np.pi / 2)
    assert view.elevation_rad == pytest.approx(np.deg2rad(45.5))
    assert (view.frame, view.zoom, view.aside) == (0, 1.25, (0.1, -0.2))


@pytest.mark.parametrize(
    "text",
    ["", "1", "1,2,3", "1,2,3,4,5", "x,2,3,4", "1,nan,3,4", "1,2,3,1e9", "1,2,3,4,5,6,7", "१,,,1"]
    + ["-1,,,1", "1,,,1\n", "9" * 12 + ",,,1", "1,,,", "1,2,3,4" + "0" * 80],
)
def test_short_form_refuses_nonsense(text: str) -> None:
    assert PictureView.from_short(text) is None


def test_camera_that_follows_cuts_nothing_off() -> None:
    for azimuth in (-3.0, 0.0, 2.0):
        near = PictureView(frame=0, azimuth_rad=azimuth, elevation_rad=9.0, zoom=0.05)
        usual = PictureView(frame=0, azimuth_rad=azimuth, elevation_rad=9.0)
        view, base = camera(near), camera(usual)
        assert view.azimuth_rad == azimuth
        assert view.elevation_rad < np.pi / 2
        assert base.distance / (2 * MIN_FOLLOW_ZOOM) < view.distance < base.distance


def test_camera_beside_the_chain_keeps_its_distance() -> None:
    level = PictureView(frame=0, azimuth_rad=0.0, elevation_rad=0.0)
    base, view = camera(level), camera(replace(level, zoom=0.25, aside=(0.1, 0.2)))
    assert view.distance == pytest.approx(0.25 * base.distance)
    assert (view.target - base.target) / base.distance == pytest.approx([0, 0.1, 0.2])


def pixels(**options: object) -> np.ndarray:
    data = social_picture(CHAIN, **options)  # pyright: ignore[reportArgumentType]
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(int)


def test_social_picture_of_a_failure_is_red() -> None:
    good = pixels(caption=Caption("Stairs", "Verified", "good"))
    bad = pixels(caption=Caption("Stairs", "Not verified", "bad"))
    assert good.shape == (SOCIAL_PICTURE_PX[1], SOCIAL_PICTURE_PX[0], 3)
    red = [(np.abs(picture - FAILED_RGB).max(axis=-1) < 8).mean() for picture in (good, bad)]
    assert red[0] < 0.001
    assert red[1] > 0.1


def test_social_picture_shows_the_moment_and_the_camera() -> None:
    errors = np.full(len(CHAIN.folded_rad), 1e-3)
    moment = Moment(poses=CHAIN.folded_poses, errors_rad=errors, error_scale_rad=1e-3)
    plain, coloured = pixels(), pixels(moment=moment)
    assert (coloured[..., 0] - coloured[..., 2]).max() > 100 > (plain[..., 0] - plain[..., 2]).max()
    side = PictureView.from_short("1,30,60,1.5")
    assert side is not None
    assert np.abs(pixels(view=side) - plain).max() > 50


def test_caption_leaves_out_letters_that_the_font_lacks() -> None:
    shown = [Image.new("RGB", SOCIAL_PICTURE_PX) for _ in range(2)]
    for picture, name in zip(shown, ("Fold", "Fold\u6298\u308a"), strict=True):
        write_caption(picture, Caption(name, "Verified", "good"))
    assert shown[0].tobytes() == shown[1].tobytes()
