"""Requests that wait for frames or follow a fold: limited, and without threads of their own."""

import asyncio
import threading
from collections import Counter
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.motion.timeline import TimelineWriter
from foldback.server.jobs.eta import EtaEstimator
from foldback.server.pages import player_data as frame_routes
from foldback.server.store.schema import FoldRow
from foldback.server.viewing import fold_states
from foldback.web.timeline.view import TimelineView
from tests.planner.chains import chain_of
from tests.server.http.test_threats_crowding import from_address
from tests.server.service_process import SNAKE, TIMEOUT_S, Service, wait_until
from tests.server.service_thread import ServiceWith
from tests.web.conftest import unfolding

FRAMES = 10


def growing_fold(service: Service) -> tuple[str, TimelineWriter, Chain]:
    """Return a queued fold with a timeline of ten frames that grows."""
    fold = service.fold(SNAKE)["id"]
    chain = chain_of(SNAKE)
    writer = TimelineWriter.create(service.directory(fold) / "timeline", chain)
    writer.append(unfolding(chain, FRAMES))
    writer.flush()
    return fold, writer, chain


async def ask(
    service: Service, path: str, visitors: list[str], between: Callable[[], object] | None = None
) -> list[httpx.Response]:
    """Return the answers to one request per visitor, all sent at once."""
    limits = httpx.Limits(max_connections=None)
    async with httpx.AsyncClient(
        base_url=service.http.base_url, timeout=30, limits=limits
    ) as client:
        requests = [client.get(path, headers=from_address(visitor)) for visitor in visitors]
        tasks = [asyncio.create_task(request) for request in requests]
        if between is not None:
            await asyncio.sleep(0.3)
            await asyncio.to_thread(between)
        return await asyncio.gather(*tasks)


def test_waits_beyond_the_quota_are_refused(service_with: ServiceWith) -> None:
    """tests/server/limits tests how quotas are shared."""
    service = service_with(max_waits_of_visitor=2, max_waits=6).start()
    fold, _, _ = growing_fold(service)
    address = f"/folds/{fold}/batch?from={FRAMES}&wait="
    visitors = ["203.0.113.1"] * 3 + ["203.0.113.2"] * 2
    answers = asyncio.run(ask(service, f"{address}0.5", visitors))
    refused = [answer for answer in answers if answer.status_code == 429]
    assert len(refused) == 2
    assert {answer.json()["code"] for answer in refused} == {"too-many-waits"}
    assert {int(answer.headers["retry-after"]) for answer in refused} == {2}
    assert "of yours" in refused[0].json()["detail"]
    assert "from your network" in refused[1].json()["detail"]
    # Permits are released; requests that do not wait need none.
    for wait in ("0.01", "0"):
        own_address = from_address(visitors[0])
        assert service.http.get(address + wait, headers=own_address).status_code == 200


def test_waits_share_one_thread_and_are_answered_together(
    service_with: ServiceWith, monkeypatch: pytest.MonkeyPatch
) -> None:
    service = service_with().start()
    fold, writer, chain = growing_fold(service)
    refreshes: Counter[str] = Counter()
    refresh = TimelineView.refresh

    def count_refresh(view: TimelineView, *, at_once: bool = False) -> bool:
        refreshes[threading.current_thread().name.rpartition("_")[0]] += 1
        return refresh(view, at_once=at_once)

    def grow() -> None:
        wait_until(lambda: refreshes["frame-waits"] >= 2)
        writer.append(unfolding(chain, 5))
        writer.flush()

    monkeypatch.setattr(TimelineView, "refresh", count_refresh)
    visitors = [f"198.51.{k}.1" for k in range(20)]
    answers = asyncio.run(ask(service, f"/folds/{fold}/batch?from={FRAMES}&wait=2", visitors, grow))
    assert {answer.status_code for answer in answers} == {200}
    assert len({answer.content for answer in answers}) == 1 and len(answers[0].content) > 500
    # Each request checks once, on arrival; the single thread makes all further checks.
    assert refreshes.total() - refreshes["frame-waits"] <= len(visitors)


def test_wait_of_a_new_network_displaces_one_of_the_largest(service_with: ServiceWith) -> None:
    service = service_with(max_waits=4, max_waits_of_visitor=2).start()
    fold, _, _ = growing_fold(service)
    crowd = ["203.0.113.1", "203.0.113.2", "198.51.100.1", "198.51.100.2", "192.0.2.1"]
    answers = asyncio.run(ask(service, f"/folds/{fold}/batch?from={FRAMES}&wait=1", crowd))
    assert {answer.status_code for answer in answers} == {200}


def test_states_of_all_folds_are_read_by_one_thread(
    service_with: ServiceWith, monkeypatch: pytest.MonkeyPatch
) -> None:
    service = service_with().start()
    folds = [service.fold(SNAKE, seed=k)["id"] for k in range(4)]
    threads: set[str] = set()
    read = fold_states.progress_of

    def note_thread(row: FoldRow, remaining: EtaEstimator) -> dict[str, Any]:
        threads.add(threading.current_thread().name)
        return read(row, remaining)

    monkeypatch.setattr(fold_states, "progress_of", note_thread)
    for fold in folds:
        assert next(iter(service.events(fold)))[0] == "progress"
    assert len(threads) == 1 and threads.pop().startswith("fold-states")


def test_batches_of_one_visitor_leave_threads_to_others(
    service_with: ServiceWith, monkeypatch: pytest.MonkeyPatch
) -> None:
    service = service_with().start()
    fold, _, _ = growing_fold(service)
    go_on, answers = threading.Event(), list[httpx.Response]()
    make = frame_routes.cached_batch

    def slow(*arguments: Any) -> bytes:
        go_on.wait(TIMEOUT_S)
        return make(*arguments)

    def request_page() -> None:
        try:
            stranger = from_address("198.51.100.1")
            answers.append(service.http.get(f"/folds/{fold}", headers=stranger, timeout=10))
        finally:
            go_on.set()

    monkeypatch.setattr(frame_routes, "cached_batch", slow)
    flood = asyncio.run(ask(service, f"/folds/{fold}/batch", ["203.0.113.1"] * 60, request_page))
    assert [answer.status_code for answer in (*answers, *flood)] == [200] * 61
