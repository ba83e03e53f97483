"""The success map: its cases and its picture. test_stored.py checks that no case is run twice."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from bench.success_map.__main__ import (
    BOXES,
    KINDS,
    METHODS,
    cases,
    path_of,
)
from bench.success_map.picture import picture
from planner.chain.path import Path
from tests.case import case

pytestmark = pytest.mark.slow


def test_every_kind_of_path_fills_the_box() -> None:
    box = BOXES[64]
    for kind in KINDS:
        with case(kind):
            cells = path_of(kind, box, 1)
            assert np.array_equal(np.unique(cells, axis=0), np.argwhere(np.ones(box, dtype=bool)))
            Path.from_cells([tuple(cell) for cell in cells.tolist()], name="box")  # must be a path


def test_cases_are_unique_and_large_ones_limited_to_methods_that_end() -> None:
    found = list(cases(4096))
    assert len(found) == len(set(found))
    assert {case.method for case in found} == set(METHODS)
    assert {case.method for case in found if case.modules == 4096} == {"one-by-one", "peel", "auto"}
    assert max(case.modules for case in cases(64)) == 64


def test_picture_shows_shares_of_verified_folds() -> None:
    shares = {
        ("a", "x", 8): (2, 0, 2),
        ("a", "y", 8): (0, 0, 2),
        ("b", "x", 8): (1, 0, 2),
        ("b", "y", 8): (0, 2, 2),
    }
    drawn = ElementTree.fromstring(picture(shares, ("a", "b"), ("x", "y"), (8,)))
    cells = {
        parts[0].text: [(part.get("class"), part.get("height")) for part in parts[1:]]
        for parts in (list(cell) for cell in drawn.iter() if cell.tag.endswith("}g"))
    }
    assert cells == {
        "2 of 2 verified (simulated)": [("cell", "21"), ("good", "21.0")],
        "1 of 2 verified (simulated)": [("cell", "21"), ("good", "10.5")],
        "2 of 2 verified (kinematics only)": [("cell", "21"), ("kinematics", "21.0")],
        "0 of 2 verified": [("cell", "21"), ("cross", None)],
    }
