"""Isometric drawings of cells and of chains."""

import re
import xml.etree.ElementTree as ElementTree
from itertools import product

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.readers.angle_strings import read_angle_string
from foldback.web.pictures.isometric import isometric_svg
from foldback.web.pictures.isometric_modules import chain_svg

SVG = "{http://www.w3.org/2000/svg}"
RING = "- - - + - - - + - - -"


def drawing(cells: object, **options: object) -> ElementTree.Element:
    return ElementTree.fromstring(isometric_svg(cells, **options))  # type: ignore[arg-type]


def faces(root: ElementTree.Element, tone: str) -> int:
    paths = [p for p in root.iter(f"{SVG}path") if p.get("class") == f"iso-{tone}"]
    return sum(p.get("d", "").count("M") for p in paths)


def test_box_shows_only_the_faces_of_its_outside() -> None:
    for side in (1, 2, 5):
        root = drawing(np.array(list(product(range(side), repeat=3))) + [5, -2, 7])
        assert [faces(root, tone) for tone in ("top", "left", "right")] == [side**2] * 3
        assert_within_view(root)
    assert faces(drawing(np.zeros((0, 3), dtype=int)), "gap") == 0


def test_hidden_cell_is_left_out_and_half_a_face_is_drawn() -> None:
    assert faces(drawing([(0, 0, 0), (4, -4, 4)]), "gap") == 3
    # The upper cell hides half of the lower one's top and half of one side.
    assert faces(drawing([(0, 0, 0), (1, 0, 1)]), "gap") == 6


def test_axes_point_as_in_the_3d_view_with_z_upward() -> None:
    def middle(cell: tuple[int, int, int]) -> np.ndarray:
        left_px, top, width, height = map(float, drawing([cell]).get("viewBox", "").split())
        return np.array([left_px + width / 2, top + height / 2])

    x, y, z = (middle(tuple(cell)) - middle((0, 0, 0)) for cell in np.eye(3, dtype=int).tolist())
    assert min(x) > 0
    assert y[1] < 0 < y[0]
    assert z[1] < 0 == round(z[0], 6)


def assert_within_view(root: ElementTree.Element) -> None:
    left_px, top, width, height = (float(v) for v in root.get("viewBox", "").split())
    text = "".join(path.get("d", "") for path in root.iter(f"{SVG}path"))
    points = np.array(re.findall(r"[ML](-?[\d.]+) ?(-?[\d.]+)", text), dtype=float)
    assert len(points)
    assert (points >= [left_px, top]).all()
    assert (points <= [left_px + width, top + height]).all()


def test_isometric_odd_and_added_cells_have_colours_of_their_own() -> None:
    cells = [(0, 0, 0), (1, 0, 0), (2, 0, 0)]
    assert faces(drawing(cells), "odd-top") == 0
    root = drawing(cells, odd=[(1, 0, 0)], added=[(3, 0, 0)])
    assert [faces(root, tone) for tone in ("top", "odd-top", "added-top")] == [2, 1, 1]


def test_title_is_escaped_and_a_drawing_without_one_is_hidden() -> None:
    root = drawing([(0, 0, 0)], title='a <b> & "c"')
    assert root.get("aria-label") == 'a <b> & "c"'
    assert root.findtext(f"{SVG}title") == 'a <b> & "c"'
    assert drawing([(0, 0, 0)]).get("aria-hidden") == "true"


def test_chain_of_cubes_is_drawn_as_its_cells() -> None:
    path = Path.from_cells([[0, 0, 0], [1, 0, 0], [1, 1, 0]])
    assert chain_svg(Chain.from_path(path)) == isometric_svg(path.cells)


def test_ring_of_tetrahedra_shows_outer_faces_within_the_view() -> None:
    root = ElementTree.fromstring(chain_svg(read_angle_string(RING), title="<b> & co"))
    assert root.findtext(f"{SVG}title") == "<b> & co"
    drawn = root.findall(f"{SVG}path")
    # A seam and a face for each; about half of the 24 outer faces of the closed ring are visible.
    assert len(drawn) % 2 == 0
    assert 16 <= len(drawn) <= 28
    assert all(p.get("fill", "").startswith("#") for p in drawn)
    assert_within_view(root)
