from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from planner.chain.chain import Chain
from planner.chain.path import Path as CellPath
from planner.readers import read
from planner.readers.gallery import Gallery
from web.pictures.lighting import THEMES
from web.pictures.social_picture import SOCIAL_PICTURE_PX, social_picture


def pixels(chain: Chain) -> np.ndarray:
    data = social_picture(chain)
    with Image.open(io.BytesIO(data)) as picture:
        assert (picture.format, picture.size, picture.mode) == ("PNG", SOCIAL_PICTURE_PX, "RGB")
        return np.asarray(picture).astype(int)


def drawn(picture: np.ndarray) -> np.ndarray:
    """Where modules are: neither lit ground nor its shadow, which is warm."""
    return (picture.max(axis=-1) < 235) & (picture[..., 0] - picture[..., 2] < 12)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["wrench-160", pytest.param("tetra-wrench", marks=pytest.mark.long)]
)
def test_the_shape_fills_the_picture_and_is_whole(name: str) -> None:
    shape = Gallery().shape(name)
    found = read(shape.data, filename=shape.filename)
    picture = pixels(found if isinstance(found, Chain) else Chain.from_path(found))
    rows, columns = np.nonzero(drawn(picture))
    assert max(np.ptp(rows) / SOCIAL_PICTURE_PX[1], np.ptp(columns) / SOCIAL_PICTURE_PX[0]) > 0.6
    edge = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
    assert np.abs(edge - THEMES["light"].ground).max() < 30
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 200  # shades, not a silhouette


def test_another_shape_gives_another_picture() -> None:
    rows = [(x, 0, 0) for x in range(8)]
    square = [(x if y % 2 == 0 else 3 - x, y, 0) for y in range(4) for x in range(4)]
    row, folded = (
        drawn(pixels(Chain.from_path(CellPath.from_cells(cells, name="x"))))
        for cells in (rows, square)
    )
    assert np.ptp(np.nonzero(row)[0]) < np.ptp(np.nonzero(folded)[0])
