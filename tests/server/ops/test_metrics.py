"""Metrics for operators: correct, bounded in number, and readable only with permission."""

import time
import uuid
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from prometheus_client.parser import text_string_to_metric_families
from pydantic import SecretStr

from foldback.server.api.health import PROXY_HEADERS
from foldback.server.ops.supervisor import environment_of_worker
from foldback.server.settings import Settings
from foldback.server.store.folds import Store
from foldback.server.store.leases import Leases
from foldback.server.store.stats import Stats
from tests.server.rows import a_fold, live_worker, statements
from tests.server.service_process import METRICS_TOKEN, SNAKE, FinishedFold, Service, bearer
from tests.server.service_thread import ServiceWith


def figures(service: Service) -> dict[tuple[str, tuple[tuple[str, str], ...]], float]:
    """Return all samples, by name and labels."""
    answer = service.metrics()
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/plain; version=0.0.4")
    metric_values: dict[tuple[str, tuple[tuple[str, str], ...]], float] = {}
    for family in text_string_to_metric_families(answer.text):
        assert family.documentation
        for sample in family.samples:
            key = (sample.name, tuple(sorted(sample.labels.items())))
            assert key not in metric_values, f"told twice: {key}"
            metric_values[key] = sample.value
    return metric_values


def value(metric_values: dict[Any, float], name: str, **labels: str) -> float:
    return metric_values[(f"foldback_{name}", tuple(sorted(labels.items())))]


def test_finished_folds_are_counted_and_timed(finished: FinishedFold) -> None:
    computed_figures = figures(finished.service)
    assert finished.state["status"] == "verified"
    assert value(computed_figures, "folds", status="verified") >= 1
    assert value(computed_figures, "folds", status="queued") == value(
        computed_figures, "queue_length"
    )
    for name in ("workers", "database_up", "storage_up", "disk_up"):
        assert value(computed_figures, name) == 1, name
    assert value(computed_figures, "disk_free_bytes") > 0
    took = [value(computed_figures, "fold_seconds_lately", quantile=q) for q in ("0.5", "0.9", "1")]
    assert took == sorted(took) and took[-1] > 0
    assert computed_figures[("process_resident_memory_bytes", ())] > 1e6


def test_requests_are_timed_by_route_and_strange_ones_add_no_metrics(idle: Service) -> None:
    labels = {"method": "GET", "route": "/api/folds/{fold_id}", "status": "4xx"}
    for path in ("/nowhere", "/folds/x", "/api/folds/x"):
        idle.http.get(path)
    idle.http.request("FORGE", "/health")
    idle.metrics()  # the metrics route counts as well
    before = figures(idle)
    for n in range(3):
        for path in ("", "folds/", "api/folds/"):
            idle.http.get(f"/{path}{uuid.uuid4().hex}")
        idle.http.request(f"FORGE{n}", "/health")
    after = figures(idle)
    assert set(after) == set(before)
    counts = [
        value(earlier_values, "request_seconds_count", **labels)
        for earlier_values in (before, after)
    ]
    assert counts[1] == counts[0] + 3
    assert value(after, "requests_in_progress") == 1  # the request itself


def test_open_streams_are_counted(idle: Service) -> None:
    fold = idle.fold(SNAKE, seed="777")
    with idle.http.stream("GET", f"/api/folds/{fold['id']}/events") as stream:
        events = stream.iter_lines()  # keeps the stream open
        next(events)
        computed_figures = figures(idle)
        assert fold["id"] not in str(computed_figures)
        assert value(computed_figures, "streams_open") == 1
        assert value(computed_figures, "requests_in_progress") == 2


def test_metrics_without_the_token_are_closed_from_any_address(
    idle: Service, service_with: ServiceWith
) -> None:
    for headers in (
        {"Connection": "close"},
        {"Authorization": "Bearer"},
        {"Authorization": f"Bearer {METRICS_TOKEN}x"},
        {"Authorization": f"Basic {METRICS_TOKEN}"},
        {"Authorization": b"Bearer \xff\xfe"},
    ):
        answer = idle.http.get("/metrics", headers=headers)
        assert (answer.status_code, answer.json()["code"]) == (403, "not-public"), headers
        assert METRICS_TOKEN not in answer.text
    without = service_with(metrics_token="").start()
    assert without.metrics().status_code == 403
    assert without.http.get("/metrics", headers={"Authorization": "Bearer"}).status_code == 403


@pytest.mark.parametrize("path", ["/metrics", "/ready"])
def test_routes_of_operators_are_closed_to_requests_through_a_proxy(
    service_with: ServiceWith, path: str
) -> None:
    service = service_with(base_path="/fold", metrics_public=True).start()
    assert service.http.get(path).status_code in (200, 503)
    for name in PROXY_HEADERS:
        for method in ("GET", "HEAD"):
            answer = service.http.request(method, path, headers={name: "203.0.113.9"})
            assert answer.status_code == 404, name
    operator = bearer(METRICS_TOKEN)
    for way in (
        *(
            f"/fold{path}",
            f"/fold{path}?x",
            f"/fold/%{ord(path[1]):02x}{path[2:]}",
            f"/fold/{path}",
        ),
        *(f"/fold{path}/", f"/fold/.{path}", f"/fold/fold{path}", f"/fold{path.upper()}"),
        *(f"/FOLD{path}", f"/%66old{path}", f"/fold%2f{path[1:]}", f"/fold/x/..{path}"),
    ):
        answer = service.http.get(way, headers=operator, follow_redirects=True)
        assert answer.status_code == 404, way
        assert "foldback_" not in answer.text and '"workers"' not in answer.text


def test_metrics_token_that_is_short_is_refused_without_repeating_it() -> None:
    with pytest.raises(ValueError, match="got a token of 5 characters") as refused:
        Settings(metrics_token=SecretStr("12a45"))
    assert "12a45" not in str(refused.value)
    assert METRICS_TOKEN not in repr(Settings(metrics_token=SecretStr(METRICS_TOKEN)))


def test_stats_are_cached(tmp_path: Path, store: Store) -> None:
    settings = Settings(data_dir=tmp_path)
    with closing(Stats(settings, Leases(settings, store))) as stats, statements() as queries:
        stats.counts()
        once = len(queries)
        for _ in range(100):
            stats.counts()
    assert 0 < once <= 10  # a few queries set up the connection
    assert len(queries) <= 2 * once


def test_stats_count_rows(each_settings: Settings, each_store: Store) -> None:
    now = time.time()
    with each_store.changing() as session:
        for n, status in enumerate(["queued", "queued", "running", "verified", "failed"]):
            over = {"started_at": now - 100.0, "ended_at": now - 100.0 + 10.0 * n}
            values = over if status in ("verified", "failed") else {}
            error = {"code": "internal"} if status == "failed" else None
            expected = {
                "status": status,
                "created_at": now - 1000.0,
                "bytes": 10**n,
                "error": error,
            }
            session.add(a_fold(f"fold{n}", **expected, **values))
        session.add(a_fold("old", status="failed", started_at=1.0, ended_at=2.0))
    leases = Leases(each_settings, each_store)
    with live_worker(leases, "w/0"), closing(Stats(each_settings, leases)) as stats:
        service_counts = stats.counts()
    assert service_counts.folds == {
        "queued": 2,
        "running": 1,
        "verified": 1,
        "failed": 2,
        "cancelled": 0,
    }
    assert 1000 <= service_counts.oldest_queued_s < 1100
    assert (service_counts.storage_bytes, service_counts.workers) == (11111, 1)
    assert service_counts.computed_s == pytest.approx((30.0, 40.0))
    assert service_counts.failures == {"internal": 1}


def test_metrics_token_is_not_passed_to_workers() -> None:
    settings = Settings(metrics_token=SecretStr(METRICS_TOKEN))
    environment = environment_of_worker(settings)
    assert environment["FOLDBACK_PORT"] == str(settings.port)
    assert "FOLDBACK_METRICS_TOKEN" not in environment
