from __future__ import annotations

from pathlib import Path

import pytest

from docs.make_drawings import PICTURES, drawn
from examples.make_pictures import pictures
from web.pictures.shipped import shipped_pictures

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize(("name", "shape", "title"), PICTURES)
def test_the_readme_shows_the_shapes_as_they_are(name: str, shape: str, title: str) -> None:
    assert (DOCS / "pictures" / name).read_text(encoding="utf-8") == drawn(shape, title)


def test_both_wrenches_have_the_same_cells() -> None:
    """Cubes of 2×2×2 and rings of twelve stand for the same sixteen cells."""
    from examples.make_gallery import drawings
    from examples.make_tetrahedra import SHAPES

    (cubes,) = (shape.blocks for shape in drawings() if shape.name == "wrench-128")
    (rings,) = (cells for name, _, _, cells in SHAPES if name == "tetra-wrench")
    assert {(y, z) for _, y, z in cubes} == {(y, z) for _, y, z in rings}
    assert len(cubes) == len(rings) == 16


SAMPLE = ("wrench-160-480.svg", "heart-160.svg", "tetra-ring-160.svg", "featured.bundle")
"""Pictures of each kind that are drawn again here; ``make test-long`` draws all."""


def test_shipped_pictures_hold_all_that_are_made() -> None:
    assert list(shipped_pictures()) == [name for name, _ in pictures()]


@pytest.mark.parametrize("name", SAMPLE)
def test_shipped_picture_is_what_product_draws(name: str) -> None:
    assert shipped_pictures()[name] == dict(pictures())[name]()


@pytest.mark.long
def test_all_shipped_pictures_are_what_product_draws() -> None:
    assert shipped_pictures() == {name: make() for name, make in pictures()}
