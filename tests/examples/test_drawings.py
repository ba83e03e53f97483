from __future__ import annotations

from pathlib import Path

import pytest

from docs.make_drawings import PICTURES, drawn

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize(("name", "shape", "title"), PICTURES)
def test_the_readme_shows_the_shapes_as_they_are(name: str, shape: str, title: str) -> None:
    assert (DOCS / name).read_text(encoding="utf-8") == drawn(shape, title)


def test_both_wrenches_have_the_same_cells() -> None:
    """Cubes of 2×2×2 and rings of twelve stand for the same sixteen cells."""
    from examples.make_gallery import drawings
    from examples.make_tetrahedra import SHAPES

    (cubes,) = (shape.blocks for shape in drawings() if shape.name == "wrench-128")
    (rings,) = (cells for name, _, _, cells in SHAPES if name == "tetra-wrench")
    assert {(y, z) for _, y, z in cubes} == {(y, z) for _, y, z in rings}
    assert len(cubes) == len(rings) == 16
