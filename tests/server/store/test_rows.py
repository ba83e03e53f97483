"""Rows of folds: who may end them, and that an end is final."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from threading import Barrier
from typing import Any

import pytest

from foldback.server.jobs.queue import FoldClaim, Queue
from foldback.server.jobs.slices import SLICE_POLL_S, Slice
from foldback.server.limits.fair_queue import slice_s, wait_s
from foldback.server.store.folds import NoSuchFoldError, Store
from foldback.server.store.schema import FoldRow
from tests.server.rows import a_fold, new_owner

OWNER = new_owner()


def row(key: str | None = None, **extra: object) -> FoldRow:
    """Return a row of a queued fold."""
    usual: dict[str, object] = {"name": "snake", "status": "queued", "visitor": "somebody"}
    return a_fold(**usual | {"content_key": key} | extra)


def rows_in(store: Store, *rows: FoldRow) -> list[FoldRow]:
    """Add rows, each of an owner of its own, and return them."""
    for fold_row in rows:
        store.add(fold_row, new_owner())
    return list(rows)


def test_content_keys_secrets_and_ids_are_checked(store: Store) -> None:
    first, second = row("key"), row("key")
    assert store.add(first, new_owner())
    assert not store.add(second, new_owner())
    asked_fold = store.ask("key", new_owner())
    assert asked_fold is not None and asked_fold.id == first.id
    assert store.secret("visitors", b"first") == b"first"
    assert store.secret("visitors", b"second") == b"first"
    assert store.secret("others", b"third") == b"third"
    for bad in ("", "..", "a.b", "é", "a" * 33, "a\n"):
        with pytest.raises(NoSuchFoldError):
            store.directory(bad)


def test_ended_or_cancelled_fold_keeps_its_status(store: Store) -> None:
    verified, cancelled = row("a"), row("b")
    for fold in (verified, cancelled):
        store.add(fold, OWNER)
        assert store.begin(fold.id, "export", "one") == 1
    assert store.finish(verified.id, "verified", summary={"status": "verified"})
    assert store.finish(verified.id, "failed", summary={}, repeatable=False)
    assert store.begin(verified.id, "explode", "one") is None
    assert store.cancel(verified.id, OWNER)
    assert store.fold(verified.id).status == "verified"
    assert store.cancel(cancelled.id, OWNER)
    # a later report of its worker does not change the status
    assert store.finish(cancelled.id, "verified", summary={"status": "verified"}, size=10)
    ended = store.fold(cancelled.id)
    assert (ended.status, ended.summary, ended.error, ended.bytes) == ("cancelled", {}, None, 10)


def test_cancelled_fold_is_not_started_and_frees_its_key(store: Store) -> None:
    queued, running = row("a"), row("b")
    for fold in (queued, running):
        store.add(fold, OWNER)
    epoch = store.begin(running.id, "explode", "one")
    assert epoch is not None
    assert store.report(running.id, epoch, {"fraction": 0.5})
    for fold in (queued, running):
        assert store.cancel(fold.id, OWNER)
    assert store.fold(queued.id).status == "cancelled"
    assert store.begin(queued.id, "read", "one") is None
    assert not store.report(running.id, epoch, {"fraction": 0.6})
    assert not store.report(running.id, epoch)
    assert store.ask("a", OWNER) is None
    assert store.ask("b", OWNER) is None


def test_requested_fold_is_never_one_that_is_just_cancelled(each_store: Store) -> None:
    store = each_store
    outcomes: set[tuple[bool, str]] = set()
    with ThreadPoolExecutor(3) as threads:
        for number in range(8):
            first, second = new_owner(), new_owner()
            fold = row(f"key{number}", public=True, shape="wrench-24")
            store.add(fold, first)
            ready = Barrier(3)

            def run_together(do: Callable[[], Any], ready: Barrier = ready) -> Any:
                ready.wait()
                return do()

            pending_fold = threads.submit(
                run_together, partial(store.ask, fold.content_key, second)
            )
            cancelled = threads.submit(run_together, partial(store.cancel, fold.id, first))
            started = threads.submit(run_together, partial(store.begin, fold.id, "read", "one"))
            request, stopped, _ = pending_fold.result(), cancelled.result(), started.result()
            ended = store.fold(fold.id)
            assert (request is None) == stopped == ended.cancel_requested
            outcomes.add((ended.cancel_requested, ended.status))
    assert outcomes <= {(True, "cancelled"), (True, "running"), (False, "running")}


def test_earlier_execution_cannot_report_any_more(store: Store) -> None:
    fold = row()
    store.add(fold, new_owner())
    first = store.begin(fold.id, "read", "one")
    assert first == store.begin(fold.id, "explode", "one")
    assert store.begin(fold.id, "explode", "two") is None, "one has it"
    Queue(store).hand_back(FoldClaim(fold.id, "one", "explode", files=0, losses=0))
    second = store.begin(fold.id, "explode", "two")
    assert second > first
    assert not store.report(fold.id, first, {"fraction": 0.9})
    assert not store.report(fold.id, first)
    assert store.report(fold.id, second, {"fraction": 0.1})
    store.show(fold.id, first)
    assert store.fold(fold.id).kept == 0
    store.show(fold.id, second)
    assert store.fold(fold.id).kept == second
    assert store.fold(fold.id).progress == {"fraction": 0.1}


def order(store: Store, folds: list[FoldRow]) -> list[str]:
    """Return the names of folds in the order of their turns."""
    return [f.name for f in sorted([store.fold(f.id) for f in folds], key=store.ahead)]


def test_places_in_the_queue_and_the_waits_for_them(store: Store) -> None:
    folds = rows_in(store, *(row(modules=160, created_at=float(i)) for i in range(3)))
    cost_s = folds[0].cost_s
    assert [store.ahead(f)[0] for f in folds] == [1, 2, 3]
    place, ahead_s, running_s, *_ = store.ahead(store.fold(folds[2].id))
    assert (place, ahead_s, running_s) == (3, pytest.approx(2 * cost_s), 0.0)
    store.begin(folds[0].id, "read", "one")
    assert [store.ahead(f)[0] for f in folds[1:]] == [1, 2]
    assert store.waiting() == [(fold.visitor, fold.cost_s) for fold in folds]
    place, ahead_s, running_s, *_ = store.ahead(store.fold(folds[2].id))
    assert (place, ahead_s) == (2, pytest.approx(cost_s))
    assert 0.0 < running_s <= cost_s
    expected = pytest.approx((ahead_s + running_s) / 2)
    assert wait_s(ahead_s=ahead_s, running_s=running_s, at_once=2) == expected
    assert wait_s(ahead_s=ahead_s, running_s=running_s, at_once=0) is None


@pytest.mark.parametrize(
    ("patient", "overtaking", "minimum"),
    [
        ({"modules": 280}, {"modules": 64}, 4),
        ({"modules": 160, "preset": "direct"}, {"modules": 64, "prefer": "time"}, 1),
    ],
    ids=["long", "baseline"],
)
def test_long_fold_is_overtaken_a_limited_number_of_times(
    store: Store, patient: dict[str, Any], overtaking: dict[str, Any], minimum: int
) -> None:
    (long,) = rows_in(store, row(visitor="patient", **patient))
    for served in range(100):
        (short,) = rows_in(store, row(visitor=f"visitor {served}", **overtaking))
        if store.ahead(store.fold(long.id)).place == 1:
            break
        store.begin(short.id, "read", "one")
        store.finish(short.id, "verified", summary={})
    assert minimum <= served < 99


TURNS: dict[str, list[dict[str, Any]]] = {
    "greedy 0, modest 0, greedy 1, modest 1, greedy 2, greedy 3": [
        *({"name": f"greedy {i}", "visitor": "greedy"} for i in range(4)),
        *({"name": f"modest {i}", "visitor": "modest"} for i in range(2)),
    ],
    "many 0, one 0, many 1, one 1": [
        *({"name": f"many {i}", "visitor": f"2001:db8::/48|{i}"} for i in range(2)),
        *({"name": f"one {i}", "visitor": "2001:db8:1::/48|0"} for i in range(2)),
    ],
    "gallery, short, long": [
        {"name": "long", "visitor": "a", "modules": 250},
        {"name": "short", "visitor": "b", "modules": 16},
        {"name": "gallery", "visitor": "c", "modules": 200, "public": True},
    ],
}


@pytest.mark.parametrize("turns", TURNS)
def test_networks_take_turns_whatever_their_visitors(store: Store, turns: str) -> None:
    """Visitors of a network take turns as well, and their short folds precede long ones."""
    assert ", ".join(order(store, rows_in(store, *(row(**r) for r in TURNS[turns])))) == turns


def a_running_fold(store: Store, **values: Any) -> tuple[FoldRow, int]:
    fold = row(**values)
    store.add(fold, new_owner())
    epoch = store.begin(fold.id, "explode", "one")
    assert epoch is not None
    return fold, epoch


@pytest.mark.parametrize("preset", ["direct", "paper"])
def test_short_folds_do_not_wait_for_a_running_baseline(store: Store, preset: str) -> None:
    baseline, _ = a_running_fold(store, modules=160, preset=preset)
    refold = row(visitor="another", modules=160, refold="wrench-160")
    store.add(refold, new_owner())
    ahead = store.ahead(store.fold(refold.id))
    assert (ahead.place, ahead.running) == (1, 0), "it has a place of its own in each worker"
    # A longer fold shares the slot with the baseline.
    several = row(visitor="another", modules=64, prefer="time")
    store.add(several, new_owner())
    assert store.ahead(store.fold(several.id)).running == 1
    assert store.others_wait(baseline.id, spent_s=1.0, cheaper=True)


@pytest.mark.parametrize(
    ("modules", "waiting", "cheaper", "over"),
    [
        (1000, [], False, False),
        (1000, [16], False, False),  # short folds have a slot of their own
        (1000, [900], True, True),
        (900, [1000], True, False),
        (64, [16], False, True),
    ],
)
def test_fold_makes_room_only_for_folds_that_wait_for_it(
    store: Store, modules: int, waiting: list[int], cheaper: bool, over: bool
) -> None:
    fold, _ = a_running_fold(store, modules=modules)
    for waiting_fold in waiting:
        store.add(row(visitor="another", modules=waiting_fold), new_owner())
    assert store.others_wait(fold.id, spent_s=1.0, cheaper=cheaper) == over


def test_paused_fold_waits_with_the_cost_it_has_spent(store: Store) -> None:
    fold, epoch = a_running_fold(store, modules=16, name="paused")
    store.add(row(visitor="another", name="waits", modules=2000), new_owner())
    assert store.pause(fold.id, epoch, spent_s=40.0)
    paused = store.fold(fold.id)
    assert (paused.status, paused.pauses, paused.cost_s) == ("queued", 1, 40.0)
    assert order(store, [paused]) == ["paused"]
    assert store.ahead(paused)[0] == 2
    assert not store.pause(fold.id, epoch, spent_s=1.0), "it does not run"
    second = store.begin(fold.id, "explode", "two")
    assert second is not None and second > epoch
    assert not store.pause(fold.id, epoch, spent_s=1.0), "another execution has it"


@pytest.mark.parametrize(
    ("cost_s", "pauses", "for_cheaper", "seconds"),
    [
        (1.0, 0, False, 10.0),
        (100.0, 0, False, 300.0),
        (100.0, 0, True, 30.0),
        (100.0, 2, True, 270.0),
        (100.0, 9, True, 300.0),
        (2.0, 0, True, 10.0),
    ],
)
def test_slices_grow_with_every_pause(
    cost_s: float, pauses: int, for_cheaper: bool, seconds: float
) -> None:
    assert slice_s(cost_s, pauses, 30.0, for_cheaper=for_cheaper) == seconds


def test_slice_ends_when_its_time_is_over_and_another_fold_waits(store: Store) -> None:
    fold, epoch = a_running_fold(store, modules=16)
    now = [0.0]
    part = Slice(store, fold.id, epoch, clock=lambda: now[0])
    now[0] = 100.0
    assert not part.over(), "no other fold waits"
    other_row = row(visitor="another", modules=16)
    store.add(other_row, new_owner())
    assert not part.over(), "the queue was looked at a moment ago"
    now[0] += SLICE_POLL_S
    assert part.over()
    assert part.pause()
    assert store.fold(fold.id).cost_s == 100.0 + SLICE_POLL_S
    assert store.ahead(store.fold(other_row.id))[0] == 1
