"""Figures for operators: true, bounded in number, and for those only who may read them."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from prometheus_client.parser import text_string_to_metric_families
from pydantic import SecretStr
from sqlalchemy.orm import Session

from server.ops.supervisor import environment_of_worker
from server.settings import Settings
from server.store.folds import Store
from server.store.leases import Leases
from server.store.stats import Stats
from server.store.tables import WorkerRow, engine_for
from tests.server.postgres import DATABASES
from tests.server.rows import a_fold
from tests.server.service import METRICS_TOKEN, SNAKE, Service


def figures(service: Service) -> dict[tuple[str, tuple[tuple[str, str], ...]], float]:
    """All samples, by name and labels."""
    answer = service.metrics()
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/plain; version=0.0.4")
    found: dict[tuple[str, tuple[tuple[str, str], ...]], float] = {}
    for family in text_string_to_metric_families(answer.text):
        assert family.documentation
        for sample in family.samples:
            key = (sample.name, tuple(sorted(sample.labels.items())))
            assert key not in found, f"told twice: {key}"
            found[key] = sample.value
    return found


def value(found: dict[Any, float], name: str, **labels: str) -> float:
    return found[(f"foldback_{name}", tuple(sorted(labels.items())))]


def test_a_fold_is_counted_with_what_it_took(service: Service, finished: dict[str, Any]) -> None:
    found = figures(service)
    assert value(found, "folds", status="verified") >= 1
    assert value(found, "folds", status="queued") == value(found, "queue_length")
    assert value(found, "workers") == 1
    assert value(found, "database_up") == value(found, "storage_up") == value(found, "disk_up") == 1
    assert value(found, "disk_free_bytes") > 0
    state = service.state(finished["id"])
    took = [value(found, "fold_seconds_lately", quantile=q) for q in ("0.5", "0.9", "1")]
    assert took == sorted(took) and took[-1] > 0
    assert state["status"] == "verified"
    assert found[("process_resident_memory_bytes", ())] > 1e6


def test_requests_are_timed_by_route(desk: Service) -> None:
    def count(status: str) -> float:
        labels = {"method": "GET", "route": "/api/folds/{fold_id}", "status": status}
        name = ("foldback_request_seconds_count", tuple(sorted(labels.items())))
        return figures(desk).get(name, 0.0)

    before = count("4xx")
    for _ in range(3):
        desk.http.get(f"/api/folds/{uuid.uuid4().hex}")
    assert count("4xx") == before + 3
    assert value(figures(desk), "requests_in_progress") == 1  # the question itself


def test_strange_paths_and_methods_do_not_add_figures(desk: Service) -> None:
    desk.http.get("/nowhere")
    desk.http.request("FORGE", "/health")
    before = set(figures(desk))
    for n in range(50):
        desk.http.get(f"/{uuid.uuid4().hex}/{n}")
        desk.http.get(f"/folds/{uuid.uuid4().hex}")
        desk.http.request(f"FORGE{n}", "/health")
    added = {labels for _, labels in set(figures(desk)) - before}
    assert len(added) <= 16  # at most one more route's buckets: that of a fold's page
    assert not [labels for labels in added if ("method", "FORGE1") in labels]


def test_open_streams_are_counted(desk: Service) -> None:
    fold = desk.fold(SNAKE, seed="777")
    with desk.http.stream("GET", f"/api/folds/{fold['id']}/events") as stream:
        events = stream.iter_lines()  # held: the stream ends with it
        next(events)
        found = figures(desk)
        assert fold["id"] not in str(found)
        assert value(found, "streams_open") == 1
        assert value(found, "requests_in_progress") == 2


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"Connection": "close"},
        {"X-Forwarded-For": "203.0.113.9"},
        {"X-Forwarded-For": "127.0.0.1"},
        {"Forwarded": "for=127.0.0.1"},
        {"Authorization": "Bearer"},
        {"Authorization": f"Bearer {METRICS_TOKEN}x"},
        {"Authorization": f"Basic {METRICS_TOKEN}"},
        {"Authorization": b"Bearer \xff\xfe"},
    ],
    ids=str,
)
def test_metrics_without_the_token_are_closed_from_any_address(
    desk: Service, headers: dict[str, str]
) -> None:
    answer = desk.http.get("/metrics", headers=headers)
    assert answer.status_code == 403
    assert answer.json()["code"] == "not-public"
    assert METRICS_TOKEN not in answer.text


def test_metrics_of_a_service_without_a_token_are_closed(here_with: Callable[..., Service]) -> None:
    service = here_with(metrics_token="").start()
    assert service.metrics().status_code == 403
    assert service.http.get("/metrics", headers={"Authorization": "Bearer"}).status_code == 403


def test_metrics_token_that_is_short_is_refused_without_repeating_it() -> None:
    with pytest.raises(ValueError, match="got a token of 5 characters") as refused:
        Settings(metrics_token=SecretStr("12a45"))
    assert "12a45" not in str(refused.value)
    assert METRICS_TOKEN not in repr(Settings(metrics_token=SecretStr(METRICS_TOKEN)))


def test_reading_them_often_asks_the_database_seldom(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    store = Store(settings)
    stats = Stats(settings, Leases.of(settings, store))
    asked = 0

    @sa.event.listens_for(sa.Engine, "before_cursor_execute")
    def count(*_: object) -> None:
        nonlocal asked
        asked += 1

    try:
        stats.figures()
        once = asked
        for _ in range(100):
            stats.figures()
        assert 0 < once <= 10  # a few of them are about the connection itself
        assert asked <= 2 * once
    finally:
        sa.event.remove(sa.Engine, "before_cursor_execute", count)
        stats.close()
        store.close()


@pytest.mark.parametrize("kind", DATABASES)
def test_the_stats_count_rows(kind: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    url = None if kind == "sqlite" else request.getfixturevalue("postgres").database()
    settings = Settings(data_dir=tmp_path, database_url=url)
    store = Store(settings)
    now = time.time()
    engine = engine_for(settings.store_url)
    with Session(engine) as session, session.begin():
        for n, status in enumerate(["queued", "queued", "running", "verified", "failed"]):
            over = status in ("verified", "failed")
            session.add(
                a_fold(
                    f"fold{n}",
                    status=status,
                    created_at=now - 1000.0,
                    started_at=now - 100.0 if over else None,
                    ended_at=now - 100.0 + 10.0 * n if over else None,
                    bytes=10**n,
                    error={"code": "internal"} if status == "failed" else None,
                )
            )
        session.add(a_fold("old", status="failed", started_at=1.0, ended_at=2.0))
        session.add(
            WorkerRow(
                name="w/0", host="w", pid=1, beat=1, folds_at_once=1, started_at=now, version="1"
            )
        )
    stats = Stats(settings, Leases.of(settings, store))
    found = stats.figures()
    assert found.folds == {"queued": 2, "running": 1, "verified": 1, "failed": 2, "cancelled": 0}
    assert 1000 <= found.oldest_queued_s < 1100
    assert found.storage_bytes == 11111
    assert found.workers == 1
    assert found.computed_s == pytest.approx((30.0, 40.0))
    assert found.failures == {"internal": 1}
    stats.close()
    store.close()
    engine.dispose()


def test_metrics_token_is_not_passed_to_workers() -> None:
    settings = Settings(metrics_token=SecretStr(METRICS_TOKEN))
    environment = environment_of_worker(settings)
    assert environment["FOLDBACK_PORT"] == str(settings.port)
    assert "FOLDBACK_METRICS_TOKEN" not in environment
