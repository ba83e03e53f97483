from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from itertools import product

import numpy as np
import pytest

from web.pictures.isometric import isometric_svg

SVG = "{http://www.w3.org/2000/svg}"


def drawing(cells: object, **options: object) -> ElementTree.Element:
    return ElementTree.fromstring(isometric_svg(cells, **options))  # type: ignore[arg-type]


def faces(root: ElementTree.Element, tone: str) -> int:
    paths = [p for p in root.iter(f"{SVG}path") if p.get("class") == f"iso-{tone}"]
    return sum(p.get("d", "").count("M") for p in paths)


def test_one_cube_shows_three_faces() -> None:
    root = drawing([(5, -2, 7)])
    assert [faces(root, tone) for tone in ("top", "left", "right", "gap")] == [1, 1, 1, 3]


@pytest.mark.parametrize("side", [2, 3, 5])
def test_a_box_shows_only_the_faces_of_its_outside(side: int) -> None:
    root = drawing(list(product(range(side), repeat=3)))
    assert [faces(root, tone) for tone in ("top", "left", "right")] == [side**2] * 3


def test_a_cell_behind_another_is_not_drawn_and_half_a_face_is() -> None:
    assert faces(drawing([(0, 0, 0), (4, 4, 4)]), "gap") == 3
    # The upper one hides half of the top of the lower one and a half of a side.
    assert faces(drawing([(0, 0, 0), (1, 0, 1)]), "gap") == 6


def test_axes_are_right_handed_with_z_upward() -> None:
    def middle(cell: tuple[int, int, int]) -> np.ndarray:
        box = drawing([cell]).get("viewBox", "")
        left, top, width, height = (float(v) for v in box.split())
        return np.array([left + width / 2, top + height / 2])

    origin = middle((0, 0, 0))
    x, y, z = (middle(c) - origin for c in ((1, 0, 0), (0, 1, 0), (0, 0, 1)))
    assert x[0] < 0 < x[1]
    assert min(y) > 0
    assert z[1] < 0 == round(z[0], 6)
    np.testing.assert_allclose(x + y + z, 0.0, atol=0.2)


def test_everything_lies_within_the_view() -> None:
    root = drawing([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1)])
    left, top, width, height = (float(v) for v in root.get("viewBox", "").split())
    for path in root.iter(f"{SVG}path"):
        for x, y in re.findall(r"M(-?[\d.]+) ?(-?[\d.]+)", path.get("d", "")):
            assert left <= float(x) <= left + width
            assert top <= float(y) <= top + height


def test_isometric_odd_and_added_cells_have_colours_of_their_own() -> None:
    cells = [(0, 0, 0), (1, 0, 0), (2, 0, 0)]
    assert faces(drawing(cells), "odd-top") == 0
    root = drawing(cells, odd=[(1, 0, 0)], added=[(3, 0, 0)])
    assert [faces(root, tone) for tone in ("top", "odd-top", "added-top")] == [2, 1, 1]


def test_a_title_is_escaped_and_named_and_its_absence_is_decoration() -> None:
    root = drawing([(0, 0, 0)], title='a <b> & "c"')
    assert root.get("aria-label") == 'a <b> & "c"'
    assert root.findtext(f"{SVG}title") == 'a <b> & "c"'
    assert drawing([(0, 0, 0)]).get("aria-hidden") == "true"


def test_it_carries_no_style_or_script_and_stays_small() -> None:
    cells = list(product(range(10), range(10), range(2)))
    text = isometric_svg(cells, size=64)
    assert "style" not in text
    assert "script" not in text
    assert len(text) < 20_000
    assert 'width="64"' in text


def test_no_cells_make_an_empty_drawing() -> None:
    assert faces(drawing(np.zeros((0, 3), dtype=int)), "gap") == 0
