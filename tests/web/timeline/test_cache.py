from __future__ import annotations

from web.timeline.cache import Kept


def test_what_was_not_asked_for_goes_first() -> None:
    kept: Kept[str] = Kept(10)
    kept.keep("a", "A", 4)
    kept.keep("b", "B", 4)
    assert kept.get("a") == "A"
    kept.keep("c", "C", 4)
    assert [kept.get(key) for key in "abc"] == ["A", None, "C"]


def test_what_is_replaced_counts_once() -> None:
    kept: Kept[str] = Kept(10)
    kept.keep("a", "A", 4)
    for size in (6, 5, 6):
        kept.keep("b", "B", size)
    assert [kept.get(key) for key in "ab"] == ["A", "B"]


def test_what_is_too_large_is_not_kept() -> None:
    kept: Kept[str] = Kept(10)
    kept.keep("a", "A", 4)
    kept.keep("b", "B", 11)
    assert [kept.get(key) for key in "ab"] == ["A", None]
