from __future__ import annotations

import re
from collections import Counter

import numpy as np

from examples.make_gallery import HERE, drawings, drawn, lying, make, slices, standing
from planner.chain.path import Path
from planner.pathfinding.knots import knot_of
from planner.readers import read
from tests.case import case

DRAWINGS = drawings()


def test_each_file_is_made_the_same_again() -> None:
    for shape in DRAWINGS:
        with case(shape.name):
            assert make(shape) == (HERE / "shapes" / f"{shape.name}.json").read_bytes()


def test_each_file_visits_the_blocks_of_its_drawing_and_is_no_knot() -> None:
    for shape in DRAWINGS:
        with case(shape.name):
            path = read((HERE / "shapes" / f"{shape.name}.json").read_bytes())
            assert isinstance(path, Path)
            assert path.name == shape.name
            assert 60 <= len(path) <= 400
            blocks = Counter(map(tuple, (path.cells // 2).tolist()))
            assert set(blocks) == shape.blocks
            assert set(blocks.values()) == {8}
            assert knot_of(path.cells).verdict == "unknot"


def test_there_are_more_than_fifty_shapes_of_many_kinds() -> None:
    assert len(DRAWINGS) > 50
    names = [shape.name for shape in DRAWINGS]
    assert len(set(names)) == len(names)
    assert len({shape.title for shape in DRAWINGS}) == len(names)
    kinds = {tag for shape in DRAWINGS for tag in shape.tags}
    assert {"tool", "letter", "animal", "furniture", "solid", "ring", "hollow"} <= kinds


def test_every_heading_of_the_text_is_read() -> None:
    text = (HERE / "gallery.txt").read_text(encoding="utf-8")
    headings = re.findall(r"^([a-z0-9-]+): .*\(", text, flags=re.MULTILINE)
    assert headings == [shape.name for shape in drawn(text)]


def test_no_two_shapes_are_the_same() -> None:
    placed = {
        frozenset(map(tuple, (cells - cells.min(axis=0)).tolist()))
        for cells in (np.array(list(shape.blocks)) for shape in DRAWINGS)
    }
    assert len(placed) == len(DRAWINGS)


def test_a_standing_shape_rises_and_a_lying_one_is_stacked() -> None:
    assert standing(slices(["#.  ##", "##  .."])) == {(0, 0, 1), (0, 0, 0), (0, 1, 0)} | {
        (1, 0, 1),
        (1, 1, 1),
    }
    assert lying(slices(["x2  x1", "#.  .#"])) == {(0, 0, 0), (0, 0, 1), (0, 1, 2)}
