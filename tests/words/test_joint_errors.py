import math
from typing import Any

from foldback.words.joint_errors import build_words


def sampled(tolerated_deg: float, size: float | None, *, swept: bool = True) -> dict[str, Any]:
    """Return a certificate with sampled robots."""
    errors = {
        "error_rad": math.radians(0.3),
        "module_size": size,
        "tolerated_rad": math.radians(tolerated_deg),
        "robots": 300,
        "touching_at_size": 1,
        "touching_with_error": 8,
        "swept": swept,
    }
    return {"verified": True, "module_size": 0.95, "joint_errors": errors}


def test_sampled_robots_say_which_hinges_and_modules_suffice() -> None:
    words = build_words(sampled(0.0349, 0.84))
    assert words is not None
    assert words["answer"] == "Not with common parts: each hinge must be exact to 0.034°."
    assert words["size"] == "For servos of 0.3°, modules may be at most 84 % of the spacing wide."
    assert "300 robots" in words["sample"]


def test_hinges_that_suffice_are_named() -> None:
    for tolerated_deg, servos in ((2.5, "hobby servos"), (0.31, "good servos"), (0.06, "encoder")):
        words = build_words(sampled(tolerated_deg, None))
        assert words is not None
        assert words["answer"].startswith("Yes, with") and servos in words["answer"]
        assert "not exact enough, even with modules of 25 % of the spacing" in words["size"]


def test_estimate_is_no_promise() -> None:
    words = build_words(sampled(0.0349, 0.84, swept=False))
    assert words is not None
    assert words["answer"] == "Not with common parts: each hinge must be exact to about 0.034°."
    assert (
        words["size"]
        == "For servos of 0.3°, modules may be at most about 84 % of the spacing wide."
    )
    assert words["sample"].startswith("Estimated from the folded shape of 300 robots")
    words = build_words(sampled(0.31, 0.84, swept=False))
    assert words is not None
    assert words["answer"].startswith("Probably, with good servos")


def test_proved_margin_is_no_sampled_one() -> None:
    margins = {"independent_rad": {"value": math.radians(0.00229)}}
    words = build_words({"verified": True, "margins": margins})
    assert words is not None
    assert words["answer"] == "It is proved for hinges that are exact to 0.0022°."
    assert not words["sample"]
    assert build_words({"verified": False, "margins": None}) is None
