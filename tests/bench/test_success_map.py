"""The success map: its cases and its picture. test_stored.py checks that no case is run twice."""

import xml.etree.ElementTree as ElementTree

import pytest

from bench.success_map.picture import picture

pytestmark = pytest.mark.slow


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
