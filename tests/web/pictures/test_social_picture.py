"""Social pictures: the shape, the moment and camera of a link, and the caption."""

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from foldback.planner.chain.chain import Chain
from foldback.planner.readers import read
from foldback.planner.readers.gallery import Gallery
from foldback.web.pictures import SOCIAL_PICTURE_PX
from foldback.web.pictures.camera import View
from foldback.web.pictures.caption import FAILED_RGB, Caption, write_caption
from foldback.web.pictures.lighting import THEMES
from foldback.web.pictures.picture_view import MIN_FOLLOW_DISTANCE_SCALE, PictureView
from foldback.web.pictures.social_picture import Moment, social_picture
from tests.planner.chains import chain_of

POINTS = np.array([[0.0, 0, 0], [5, 0, 0], [5, 3, 0], [5, 3, 2]])
CHAIN = chain_of([(0, 0, 0), (1, 0, 0), (1, 1, 0), (2, 1, 0)])


def pixels(chain: Chain = CHAIN, **options: object) -> np.ndarray:
    data = social_picture(chain, **options)  # pyright: ignore[reportArgumentType]
    with Image.open(io.BytesIO(data)) as picture:
        assert (picture.format, picture.size, picture.mode) == ("PNG", SOCIAL_PICTURE_PX, "RGB")
        return np.asarray(picture).astype(int)


@pytest.mark.slow
def test_shape_fills_the_picture_and_is_complete() -> None:
    shape = Gallery().shape("tetra-wrench")
    picture = pixels(read(shape.data, filename=shape.filename))
    # Neither the lit ground nor its warm shadow counts.
    drawn = (picture.max(axis=-1) < 235) & (picture[..., 0] - picture[..., 2] < 12)
    rows, columns = np.nonzero(drawn)
    assert max(np.ptp(rows) / SOCIAL_PICTURE_PX[1], np.ptp(columns) / SOCIAL_PICTURE_PX[0]) > 0.6
    edge = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
    assert np.abs(edge - THEMES["light"].ground).max() < 30
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 200  # shades, not a silhouette


def camera(view: PictureView) -> View:
    return view.camera(POINTS, radius=0.9, aspect=1.9, margin=(0.8, 0.6))


def test_short_form_names_frame_and_camera() -> None:
    assert PictureView.from_short("12,,,1") == PictureView(frame=11)
    view = PictureView.from_short("1,-90,45.5,1.25,0.1,-0.2")
    assert view.azimuth_rad == pytest.approx(-np.pi / 2)
    assert view.elevation_rad == pytest.approx(np.deg2rad(45.5))
    assert (view.frame, view.zoom, view.aside) == (0, 1.25, (0.1, -0.2))


def test_short_form_refuses_nonsense() -> None:
    for text in (
        *("", "1", "1,2,3", "1,2,3,4,5", "x,2,3,4", "1,nan,3,4", "1,2,3,1e9", "1,2,3,4,5,6,7"),
        *("१,,,1", "-1,,,1", "1,,,1\n", "9" * 12 + ",,,1", "1,,,", "1,2,3,4" + "0" * 80),
    ):
        assert PictureView.from_short(text) is None, text


def test_camera_that_follows_cuts_nothing_off() -> None:
    for azimuth in (-3.0, 0.0, 2.0):
        usual = PictureView(frame=0, azimuth_rad=azimuth, elevation_rad=9.0)
        view, base = camera(replace(usual, zoom=0.05)), camera(usual)
        assert view.azimuth_rad == azimuth
        assert view.elevation_rad < np.pi / 2
        assert base.distance / (2 * MIN_FOLLOW_DISTANCE_SCALE) < view.distance < base.distance


def test_camera_beside_the_chain_keeps_its_distance() -> None:
    level = PictureView(frame=0, azimuth_rad=0.0, elevation_rad=0.0)
    base, view = camera(level), camera(replace(level, zoom=0.25, aside=(0.1, 0.2)))
    assert view.distance == pytest.approx(0.25 * base.distance)
    assert (view.target - base.target) / base.distance == pytest.approx([0, 0.1, 0.2])


def test_social_picture_shows_verdict_moment_and_camera() -> None:
    good = Caption("Stairs", "Verified", "good")
    plain = pixels(caption=good)
    bad = pixels(caption=Caption("Stairs", "Not verified", "bad"))
    red = [(np.abs(picture - FAILED_RGB).max(axis=-1) < 8).mean() for picture in (plain, bad)]
    assert red[0] < 0.001
    assert red[1] > 0.1
    errors = np.full(len(CHAIN.folded_rad), 1e-3)
    moment = Moment(poses=CHAIN.folded_poses, errors_rad=errors, error_scale_rad=1e-3)
    coloured = pixels(moment=moment, caption=good)
    assert (coloured[..., 0] - coloured[..., 2]).max() > 100 > (plain[..., 0] - plain[..., 2]).max()
    side = PictureView.from_short("1,30,60,1.5")
    assert np.abs(pixels(view=side, caption=good) - plain).max() > 50


def test_caption_leaves_out_letters_that_the_font_lacks() -> None:
    images = [Image.new("RGB", SOCIAL_PICTURE_PX) for _ in range(2)]
    for picture, name in zip(images, ("Fold", "Fold\u6298\u308a"), strict=True):
        write_caption(picture, Caption(name, "Verified", "good"))
    assert images[0].tobytes() == images[1].tobytes()
