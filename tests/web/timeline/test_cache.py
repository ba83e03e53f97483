from __future__ import annotations

from web.timeline.cache import Cache


def test_cache_drops_what_was_asked_for_least_recently() -> None:
    cache: Cache[str] = Cache(10, len)
    cache.keep("a", "aaaa")
    cache.keep("b", "bbbb")
    assert cache.get("a") == "aaaa"
    cache.keep("c", "cccc")
    assert [cache.get(key) for key in "abc"] == ["aaaa", None, "cccc"]
    cache.keep("d", 11 * "d")  # larger than all of it
    assert [cache.get(key) for key in "acd"] == ["aaaa", "cccc", None]
    cache.clear()
    assert cache.get("a") is None


def test_cache_counts_a_replaced_value_once() -> None:
    cache: Cache[str] = Cache(10, len)
    cache.keep("a", "aaaa")
    for size in (6, 5, 6):
        cache.keep("b", size * "b")
    assert [cache.get(key) for key in "ab"] == ["aaaa", "bbbbbb"]
