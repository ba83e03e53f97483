import re
from collections import Counter

import numpy as np

from examples.make_gallery import HERE, drawings, make, parse_drawings
from foldback.planner.chain.path import Path
from foldback.planner.pathfinding.knots import knot_of
from foldback.planner.readers import read
from tests.case import case

DRAWINGS = drawings()


def test_gallery_files_are_up_to_date() -> None:
    """Check some of the files, since a change of the code affects most of them."""
    for shape in DRAWINGS[::5]:
        with case(shape.name):
            assert make(shape) == (HERE / "shapes" / f"{shape.name}.json").read_bytes()


def test_gallery_files_visit_the_blocks_of_their_drawings_unknotted() -> None:
    for shape in DRAWINGS:
        with case(shape.name):
            path = read((HERE / "shapes" / f"{shape.name}.json").read_bytes())
            assert isinstance(path, Path)
            assert path.name == shape.name and 60 <= len(path) <= 400
            blocks = Counter(map(tuple, (path.cells // 2).tolist()))
            assert set(blocks) == shape.blocks
            assert set(blocks.values()) == {8}
            assert knot_of(path.cells).verdict == "unknot"


def test_gallery_has_many_different_shapes() -> None:
    assert len(DRAWINGS) > 50
    text = (HERE / "gallery.txt").read_text(encoding="utf-8")
    headings = re.findall(r"^([a-z0-9-]+): .*\(", text, flags=re.MULTILINE)
    assert headings == [shape.name for shape in parse_drawings(text)]
    placed = {
        frozenset(map(tuple, (cells - cells.min(axis=0)).tolist()))
        for cells in (np.array(list(shape.blocks)) for shape in DRAWINGS)
    }
    names = [shape.name for shape in DRAWINGS]
    for different in (names, [shape.title for shape in DRAWINGS], placed):
        assert len(set(different)) == len(DRAWINGS)
    kinds = {tag for shape in DRAWINGS for tag in shape.tags}
    assert {"tool", "letter", "animal", "furniture", "solid", "ring", "hollow"} <= kinds
