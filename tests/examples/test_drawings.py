from pathlib import Path

import numpy as np
import pytest

from docs.make_drawings import PICTURES, draw_shape
from examples.make_motions import is_of_shape
from examples.make_pictures import pictures
from foldback.planner.readers.gallery import Gallery, gallery
from foldback.web.pictures.shipped_pictures import shipped_motion, shipped_pictures
from tests.web.timeline.decoding import decode

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize(("name", "shape", "title"), PICTURES)
def test_drawings_of_the_readme_are_up_to_date(name: str, shape: str, title: str) -> None:
    assert (DOCS / "pictures" / name).read_text(encoding="utf-8") == draw_shape(shape, title)


SAMPLE = ("wrench-160-480.svg", "heart-160.svg", "tetra-ring-160.svg", "featured.bundle")
"""One picture of each kind, which this test draws again."""


def test_shipped_pictures_hold_all_that_are_made() -> None:
    assert list(shipped_pictures()) == [name for name, _ in pictures()]


@pytest.mark.parametrize("name", SAMPLE)
def test_shipped_picture_equals_a_new_drawing(name: str) -> None:
    shipped, draw_shape = shipped_pictures()[name], dict(pictures())[name]()
    if not name.endswith(".bundle"):
        assert shipped == draw_shape
        return
    # The order of a hull's corners and triangles, and last digits, may differ between machines.
    (header, columns), (drawn_header, drawn_columns) = decode(shipped), decode(draw_shape)
    assert header == drawn_header
    assert columns.keys() == drawn_columns.keys()
    for column, values in columns.items():
        assert drawn_columns[column].shape == values.shape
        if values.dtype.kind == "f":
            computed = np.sort(drawn_columns[column], axis=None)
            np.testing.assert_allclose(computed, np.sort(values, axis=None), atol=1e-6)


def test_moving_drawings_of_the_gallery_fold_into_its_shapes() -> None:
    assert [shape.name for shape in gallery() if shipped_motion(shape.name) is None] == []
    for name in ("tetra-ring", "heart"):
        shape = Gallery().shape(name)
        assert shape is not None
        assert is_of_shape((shipped_motion(name) or b"").decode(), shape)
