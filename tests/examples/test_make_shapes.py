from __future__ import annotations

import pytest

from examples import make_tetrahedra
from examples.make_gallery import drawings
from examples.make_shapes import DRAWINGS, SHAPES, Drawing, make, merged_blocks, snake
from planner.chain.path import Path
from planner.readers import read

by_name = pytest.mark.parametrize("shape", DRAWINGS, ids=lambda shape: shape.name)


@by_name
def test_each_file_visits_the_cells_of_its_drawing(shape: Drawing) -> None:
    path = read((SHAPES / f"{shape.name}.json").read_bytes())
    assert isinstance(path, Path)
    assert {tuple(cell) for cell in path.cells.tolist()} == shape.cells


@by_name
def test_a_drawing_is_made_the_same_again(shape: Drawing) -> None:
    # The solver's answer may differ between its versions; ours may not.
    if shape.path in (merged_blocks, snake):
        assert make(shape) == (SHAPES / f"{shape.name}.json").read_bytes()


def test_there_is_no_file_without_a_drawing() -> None:
    made = [name for name, *_ in make_tetrahedra.SHAPES] + ["tetra-dodecahedron"]
    drawn = [*(shape.name for shape in (*DRAWINGS, *drawings())), *made]
    assert sorted(file.stem for file in SHAPES.glob("*.json")) == sorted(drawn)
    assert [len(shape.cells) for shape in DRAWINGS] == [
        *(24, 24, 64, 80, 80, 94, 160, 160, 192, 64, 216)
    ]
