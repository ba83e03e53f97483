import shutil
import threading
from pathlib import Path

import pytest

from foldback.web.timeline import shared_views
from foldback.web.timeline.cache import Cache
from foldback.web.timeline.shared_views import TimelineViews
from foldback.web.timeline.view import TimelineView


def copies(timeline: Path, place: Path, count: int) -> list[Path]:
    return [Path(shutil.copytree(timeline, place / str(k))) for k in range(count)]


def test_views_stay_open_within_the_memory_limit(
    timeline_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []

    def counting(path: str) -> TimelineView:
        opened.append(Path(path).stem)
        return TimelineView(path)

    monkeypatch.setattr(shared_views, "TimelineView", counting)
    shared, paths = TimelineViews(), copies(timeline_path, tmp_path, 3)
    monkeypatch.setattr(shared_views, "MAX_VIEW_CACHE_BYTES", 2 * TimelineView(paths[0]).nbytes)
    for path in (*paths, paths[2], paths[1], paths[0]):
        timeline = shared.get(path)
        assert timeline and timeline.path == str(path)
    assert opened == ["0", "1", "2", "0"]


def test_slow_timeline_does_not_delay_another(
    timeline_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shared, paths = TimelineViews(), copies(timeline_path, tmp_path, 2)
    event, may_end = threading.Event(), threading.Event()
    opened: list[str] = []

    def slow(path: str) -> TimelineView:
        opened.append(path)
        if path == str(paths[0]):
            event.set()
            assert may_end.wait(30.0)
        return TimelineView(path)

    monkeypatch.setattr(shared_views, "TimelineView", slow)
    threads = [threading.Thread(target=shared.get, args=(paths[0],)) for _ in range(2)]
    other_thread = threading.Thread(target=shared.get, args=(paths[1],))
    for thread in threads:
        thread.start()
    assert event.wait(30.0)
    other_thread.start()
    other_thread.join(10.0)
    waited = other_thread.is_alive()
    may_end.set()
    for thread in (*threads, other_thread):
        thread.join(30.0)
    assert not waited
    assert sorted(opened) == [str(path) for path in paths]


def test_missing_timeline_is_searched_for_again(timeline_path: Path, tmp_path: Path) -> None:
    shared, path = TimelineViews(), tmp_path / "timeline"
    assert shared.get(path) is None
    shutil.copytree(timeline_path, path)
    assert shared.get(path) is not None


def test_cache_drops_the_least_recently_used_value() -> None:
    cache: Cache[str] = Cache(10, len)
    cache.keep("a", "aaaa")
    cache.keep("b", "bbbb")
    assert cache.get("a") == "aaaa"
    cache.keep("c", "cccc")
    assert [cache.get(key) for key in "abc"] == ["aaaa", None, "cccc"]
    cache.keep("d", 11 * "d")  # larger than the whole cache
    assert [cache.get(key) for key in "acd"] == ["aaaa", "cccc", None]
    cache.clear()
    assert cache.get("a") is None


def test_cache_counts_a_replaced_value_once() -> None:
    cache: Cache[str] = Cache(10, len)
    cache.keep("a", "aaaa")
    for size in (6, 5, 6):
        cache.keep("b", size * "b")
    assert [cache.get(key) for key in "ab"] == ["aaaa", "bbbbbb"]
