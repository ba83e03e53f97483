from __future__ import annotations

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.chain.path import Path
from planner.readers.angle_strings import read_angle_string
from web.pictures.isometric import isometric_svg
from web.pictures.isometric_modules import chain_svg

RING = "- - - + - - - + - - -"
SVG = "{http://www.w3.org/2000/svg}"


def paths(svg: str) -> list[ElementTree.Element]:
    return ElementTree.fromstring(svg).findall(f"{SVG}path")


def test_cubes_are_drawn_as_cells() -> None:
    path = Path.from_cells([[0, 0, 0], [1, 0, 0], [1, 1, 0]])
    assert chain_svg(Chain.from_path(path)) == isometric_svg(path.cells)


def test_a_ring_shows_the_outer_faces_that_look_at_us() -> None:
    drawn = paths(chain_svg(read_angle_string(RING)))
    # A seam and a face for each; of 24 outer faces of the closed ring about half are seen.
    assert len(drawn) % 2 == 0
    assert 16 <= len(drawn) <= 28
    assert all(p.get("fill", "").startswith("#") for p in drawn)


def test_faces_between_modules_are_left_out() -> None:
    straight = len(paths(chain_svg(read_angle_string("0 0 0 0"))))
    turned = len(paths(chain_svg(read_angle_string("+ + 0 0"))))
    assert turned != straight


@pytest.mark.parametrize("title", [None, "<b> & co"])
def test_titles_are_escaped(title: str | None) -> None:
    root = ElementTree.fromstring(chain_svg(read_angle_string(RING), title=title))
    found = root.find(f"{SVG}title")
    assert (None if found is None else found.text) == title


def test_everything_is_inside_the_box() -> None:
    svg = chain_svg(read_angle_string(RING))
    box = re.search(r'viewBox="([^"]+)"', svg)
    x, y, width, height = (float(v) for v in box[1].split())
    points = np.array(re.findall(r"[ML](-?[\d.]+) (-?[\d.]+)", svg), dtype=float)
    assert (points >= [x, y]).all()
    assert (points <= [x + width, y + height]).all()
