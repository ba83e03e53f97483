from zlib import compress

import numpy as np
import pytest

from foldback.planner.errors import InputError
from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.pipeline.prepare import Preparation, prepare
from foldback.planner.readers import read
from foldback.planner.silhouettes.joining import joined
from tests.planner.silhouettes.fronts import front
from tests.planner.silhouettes.pictures import as_picture, png_header, ring


def prepared(data: bytes, **options: int) -> Preparation:
    return prepare(data, "drawing.png", PathOptions(**options))


RING = ["####", "#..#", "#..#", "####"]


def test_hole_is_kept_and_background_left_out() -> None:
    preparation = prepared(as_picture(ring()), modules=96)
    assert (preparation.kind, preparation.name) == ("picture", "drawing")
    assert front(preparation) == RING
    assert preparation.likeness is not None
    assert preparation.likeness.iou == pytest.approx(1.0)
    assert preparation.chain is not None


def test_light_figure_transparency_and_jpeg_give_the_same() -> None:
    transparent = np.zeros((120, 120, 4), dtype=np.uint8)
    transparent[..., :3] = 255  # a white figure
    transparent[..., 3] = 255 - ring()
    for data in (
        as_picture(255 - ring()),
        as_picture(transparent),
        as_picture(ring(), "JPEG", quality=60),
    ):
        assert front(prepared(data, modules=96)) == RING


def test_inside_out_folds_the_background() -> None:
    inverse = prepared(as_picture(ring()), modules=8 * 24, inside_out=True)
    assert front(inverse)[0] == "######"
    assert len(front(inverse)) == 6


def test_threshold_divides_grey_from_black() -> None:
    pixels = np.full((60, 90), 255, dtype=np.uint8)
    pixels[10:50, 10:50] = 0
    pixels[10:50, 50:80] = 160
    assert len(front(prepared(as_picture(pixels), modules=128, threshold=30))[0]) == 4
    assert len(front(prepared(as_picture(pixels), modules=128, threshold=80))[0]) > 4


def test_separate_parts_are_joined_and_counted() -> None:
    pixels = np.full((60, 130), 255, dtype=np.uint8)
    pixels[10:50, 10:50] = pixels[10:50, 80:120] = 0
    preparation = prepared(as_picture(pixels), modules=256)
    assert preparation.sentences == ("3 cells join 2 parts of the picture.",)
    assert "#" * 11 in front(preparation)


def test_bridge_between_diagonal_cells_is_one_cell() -> None:
    assert joined(np.array([[True, False], [False, True]])).added == 1


@pytest.mark.parametrize("level", [0, 255, 128])
def test_picture_of_one_colour_is_refused(level: int) -> None:
    pixels = np.full((40, 40), level, dtype=np.uint8)
    pixels[3, 3] = level ^ 1
    with pytest.raises(InputError, match="one colour"):
        prepared(as_picture(pixels))


def test_picture_of_too_many_parts_is_refused() -> None:
    dots = np.full((320, 320), 255, dtype=np.uint8)
    for row in range(10, 310, 60):
        for column in range(10, 310, 50):
            dots[row : row + 30, column : column + 30] = 0
    with pytest.raises(InputError, match="30 separate parts, expected at most 24"):
        prepared(as_picture(dots), modules=1920)


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (png_header(50_000, 50_000, compress(bytes(50_000_000))), "too-large"),
        (png_header(8_000, 8_000), "too-large"),
        (png_header(100, 100), "damaged"),
        (as_picture(ring())[:100], "damaged"),
        (as_picture(ring(), "JPEG")[:100], "damaged"),
    ],
)
def test_bomb_or_damaged_picture_is_refused(data: bytes, code: str) -> None:
    with pytest.raises(InputError) as refusal:
        read(data, filename="bomb.png")
    assert refusal.value.code == code
