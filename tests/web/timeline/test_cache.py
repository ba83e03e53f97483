from __future__ import annotations

from web.timeline.cache import Cache


def test_what_was_not_asked_for_goes_first() -> None:
    cache: Cache[str] = Cache(10, len)
    cache.keep("a", "aaaa")
    cache.keep("b", "bbbb")
    assert cache.get("a") == "aaaa"
    cache.keep("c", "cccc")
    assert [cache.get(key) for key in "abc"] == ["aaaa", None, "cccc"]


def test_what_is_replaced_counts_once() -> None:
    cache: Cache[str] = Cache(10, len)
    cache.keep("a", "aaaa")
    for size in (6, 5, 6):
        cache.keep("b", size * "b")
    assert [cache.get(key) for key in "ab"] == ["aaaa", "bbbbbb"]


def test_what_is_too_large_is_not_kept() -> None:
    cache: Cache[str] = Cache(10, len)
    cache.keep("a", "aaaa")
    cache.keep("b", 11 * "b")
    assert [cache.get(key) for key in "ab"] == ["aaaa", None]
    cache.clear()
    assert cache.get("a") is None
