"""Concurrency quotas: few costly computations at once; no visitor takes all slots or the queue."""

import asyncio
import threading
from concurrent.futures import Future, ThreadPoolExecutor

import pytest

from foldback.server.errors import ServiceError, TooMany, Unavailable
from foldback.server.files.artifacts import Artifacts
from foldback.server.limits.concurrency_quota import Permit, Quota
from foldback.server.limits.fair_threads import CURRENT_VISITOR, FairThreads
from foldback.server.limits.queue_room import Waiting, check_room
from foldback.server.settings import Settings
from foldback.server.store.folds import Store
from tests.case import case


def test_visitor_cannot_take_all_places() -> None:
    quota = Quota("answers", at_once=1, total=3, per_visitor=2, timeout_s=30.0)
    go_on = threading.Event()

    def work(visitor: str) -> None:
        with quota.turn(visitor):
            go_on.wait(30.0)

    with ThreadPoolExecutor(4) as threads:

        def begin(visitor: str, permit_count: int) -> Future[None]:
            future = threads.submit(work, visitor)
            while len(quota) < permit_count:
                pass
            return future

        first, displaced = begin("a", 1), begin("a", 2)
        with pytest.raises(TooMany) as refused, quota.turn("a"):
            pass
        assert refused.value.retry_after_s == 5
        waiting_futures = [begin("b", 3), begin("c", 3)]  # c gets one of a's excess slots
        with pytest.raises(Unavailable, match="for other people") as full:
            displaced.result(30.0)
        assert full.value.code == "busy"
        with pytest.raises(Unavailable, match="for other people"), quota.turn("d"):
            pass
        go_on.set()
        for done in (first, *waiting_futures):
            done.result(30.0)
    assert len(quota) == 0


def test_waiting_ends_if_it_is_cancelled_or_takes_too_long() -> None:
    quota = Quota("answers", at_once=1, total=3, per_visitor=2, timeout_s=0.01)
    with quota.turn("a"):
        with pytest.raises(ServiceError) as refused, quota.turn("b", unwanted=lambda: True):
            pass
        assert (refused.value.code, len(quota)) == ("gone", 1)
        with pytest.raises(Unavailable), quota.turn("b"):
            pass
    assert len(quota) == 0


def test_visitor_cannot_take_all_making_of_artifacts(store: Store) -> None:
    async def ask() -> None:
        shop = Artifacts(store, total=3, per_visitor=2)
        go_on = threading.Event()

        def make() -> bool:
            return go_on.wait(30.0)

        tasks = [
            asyncio.create_task(shop.flight.get_or_make(k, make, visitor="a")) for k in range(2)
        ]
        await asyncio.sleep(0)
        with pytest.raises(TooMany) as refused:
            await shop.flight.get_or_make(2, make, visitor="a")
        assert refused.value.retry_after_s == 3
        # Waiting for a running computation costs no slot.
        tasks.append(asyncio.create_task(shop.flight.get_or_make(0, make, visitor="a")))
        tasks.append(asyncio.create_task(shop.flight.get_or_make(3, make, visitor="b")))
        await asyncio.sleep(0)
        with pytest.raises(Unavailable):
            await shop.flight.get_or_make(4, make, visitor="c")
        go_on.set()
        assert all(await asyncio.gather(*tasks))
        assert await shop.flight.get_or_make(5, make, visitor="a")
        shop.close()

    asyncio.run(ask())


def test_places_are_given_back() -> None:
    quota = Quota("event streams", total=3, per_visitor=2)
    first, _ = quota.enter("a"), quota.enter("a")
    with pytest.raises(TooMany, match="2 event streams of yours") as refused:
        quota.enter("a")
    assert (refused.value.code, refused.value.retry_after_s) == ("too-many-event-streams", 10)
    with quota.enter("b"), pytest.raises(TooMany, match="3 event streams in all"):
        quota.enter("c")
    first.leave()
    assert len(quota) == 1
    quota.enter("a")


def test_visitors_take_turns_at_the_places() -> None:
    permits: list[Permit] = []
    quota = Quota("files", total=9, per_visitor=9, at_once=2, at_once_per_visitor=1)
    a1, a2, a3, b1, b2 = (quota.enter(visitor, permits.append) for visitor in "aaabb")
    assert permits == [a1, b1]
    b2.leave()
    b1.leave()  # one of a's waiting requests proceeds
    assert permits == [a1, b1]
    c1 = quota.enter("c", permits.append)
    a1.leave()
    assert permits == [a1, b1, c1, a2]
    a2.leave()
    assert (permits[-1], len(quota)) == (a3, 2)


def test_fair_threads_serve_another_visitor_next() -> None:
    done: list[str | None] = []
    go_on, inside = threading.Event(), threading.Event()

    def occupy_slot() -> None:
        inside.set()
        go_on.wait(30.0)

    with FairThreads(2) as threads:
        futures: list[Future[None]] = []
        for visitor in ("203.0.113.0/24|203.0.113.1", "198.51.100.0/24|198.51.100.1"):
            token = CURRENT_VISITOR.set(visitor)
            if not futures:
                futures = [threads.submit(occupy_slot)]
                assert inside.wait(30.0)
                futures += [threads.submit(done.append, visitor) for _ in range(50)]
            else:  # one visitor may not occupy the last thread
                threads.submit(done.append, visitor).result(30.0)
                assert done == [visitor]
            CURRENT_VISITOR.reset(token)
        go_on.set()
        for future in futures:
            future.result(30.0)
        assert len(done) == 51
        with pytest.raises(ZeroDivisionError):
            threads.submit(lambda: 1 // 0).result(30.0)
    assert threads.submit(occupy_slot).cancelled()


SETTINGS = Settings(
    largest_queue=12,
    largest_queue_of_visitor=4,
    largest_queue_seconds=1200.0,
    largest_queue_seconds_of_visitor=400.0,
)


def queue(network: int, visitor: int, cost_s: float, count: int = 1) -> list[Waiting]:
    return count * [Waiting(f"2001:db8:{network}::/48|{visitor}", cost_s)]


def test_queue_room_is_shared_by_networks_and_visitors() -> None:
    two, crowd = queue(0, 0, 300.0) + queue(0, 1, 200.0), queue(0, 0, 1.0, 3) + queue(0, 1, 1.0, 3)
    uneven = queue(0, 0, 400.0) + queue(1, 0, 100.0)
    for waiting, expected, refused in (
        ([], (0, 0, 1200.0), None),
        ([], (0, 0, 1300.0), "0 folds are waiting"),
        (queue(0, 0, 300.0), (0, 0, 90.0), None),
        (queue(0, 0, 300.0), (0, 0, 110.0), "your waiting folds"),
        (queue(0, 0, 1.0, 4), (0, 0, 1.0), "4 of your folds"),
        # A single network may fill half of the queue, regardless of its visitors.
        (two, (0, 2, 90.0), None),
        (two, (0, 2, 210.0), "2 of them from your network"),
        (queue(0, 0, 300.0) + queue(0, 1, 300.0), (1, 0, 550.0), None),
        # The network that holds the most is refused first.
        (uneven, (0, 1, 310.0), "network"),
        (uneven, (1, 1, 310.0), None),
        (queue(0, 0, 400.0) + queue(1, 0, 400.0), (2, 0, 2.0), None),
        (crowd, (0, 2, 1.0), "6 of them from your network"),
        (crowd, (1, 0, 1.0), None),
    ):
        (fold,) = queue(*expected)
        if refused is None:
            check_room(waiting, fold, SETTINGS)
            continue
        with case(refused), pytest.raises(TooMany, match=refused) as error:
            check_room(waiting, fold, SETTINGS)
        assert error.value.code == "queue-full" and error.value.retry_after_s
