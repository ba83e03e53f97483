"""Reasons why there is no path: each code has a text, which names its values."""

from foldback.planner.pathfinding.path_reasons import TEXTS, PathCode, PathReason
from tests.case import case

VALUES = {
    **{"count": 9, "minimum": 3, "parts": 2, "largest": 5, "black": 6, "white": 3, "arms": 3},
    **{"around": 4, "places": 5, "needed": 3, "allowed": 1, "limit_s": 2.0},
    **{"cell": (1, 0, 2), "other_cell": (1, 1, 2), "ends": ((0, 0, 0), (2, 1, 2))},
    **{"paths": 1, "requested": 4, "margin": -0.2, "min_margin": 0.1, "further": 0},
}


def test_each_code_has_a_text() -> None:
    assert TEXTS.keys() == {*PathCode}
    for code in PathCode:
        with case(code):
            sentence = PathReason.of(code, **VALUES).sentence
            assert not sentence[0].islower() and sentence.endswith(".")
            assert "{" not in sentence


def test_numbers_and_places_are_put_into_words() -> None:
    for reason, text in (
        (PathReason.of(PathCode.TOO_FEW, count=1, minimum=3), "got 1 cell, expected at least 3."),
        (
            PathReason.of(PathCode.OVERHANG, count=1, parts=2),
            "1 cell with nothing below connects 2 separate parts; a chain that never goes down "
            "cannot fold such a shape.",
        ),
        (
            PathReason.of(PathCode.TIPS_OVER, margin=-0.25, layers=2),
            "a chain folds the lowest 2 layers first, and this part would tip over: its centre of "
            "mass is 0.25 spacings outside its base.",
        ),
        (
            PathReason.of(PathCode.FIRST_LINK).with_values(found=True),
            "the search found a path, but the chain cannot follow it: the path must start with "
            "two cells on the floor, but at least one of its first two cells is higher.",
        ),
        (
            PathReason.of(PathCode.PARTS, layer=2, parts=3),
            "layer 2 from the bottom: it consists of 3 separate parts; a chain that never goes "
            "down cannot leave a layer and come back.",
        ),
    ):
        with case(text):
            assert reason.text == text
