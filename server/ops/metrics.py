"""Metrics of the service for Prometheus."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from prometheus_client import CollectorRegistry, Gauge, Histogram, ProcessCollector, generate_latest

from foldback.server.ops.readiness import OK, Places
from foldback.server.store.stats import ServiceCounts

METRICS_MEDIA_TYPE: Final = "text/plain; version=0.0.4; charset=utf-8"


class Metrics:
    """Counters of the web process.

    Attributes:
        in_progress: Number of requests in progress.
        websockets: Number of open websockets.
    """

    def __init__(self) -> None:
        self._registry = CollectorRegistry()
        ProcessCollector(registry=self._registry)
        self._seconds = Histogram(
            "foldback_request_seconds",
            "Time to send a response; for event streams, the time until they are closed.",
            ("method", "route", "status"),
            buckets=(0.005, 0.01, 0.025, 0.05, 0.1, 0.15, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 60.0),
            registry=self._registry,
        )
        self.in_progress = Gauge(
            "foldback_requests_in_progress",
            "Requests in progress, event streams included.",
            registry=self._registry,
        )
        self.websockets = Gauge(
            "foldback_websockets_open",
            "Open websockets of pages and target streams.",
            registry=self._registry,
        )

    def count(self, *, method: str, route: str, status: int, seconds: float) -> None:
        """Count one HTTP response."""
        self._seconds.labels(method, route, f"{status // 100}xx").observe(seconds)

    def text(
        self, counts: ServiceCounts | None, places: Places, *, streams: int, target_streams: int
    ) -> bytes:
        """Return all metrics in the text format of Prometheus.

        Args:
            counts: Counts of rows; None if the database does not answer.
            places: State of disk and storage.
            streams: Number of open event streams.
            target_streams: Number of open target streams.
        """
        rows = CollectorRegistry()
        _set(rows, "streams_open", "Open event streams.", streams)
        _set(rows, "target_streams_open", "Open target streams.", target_streams)
        _set_places(rows, places)
        _set(rows, "database_up", "1 if the database answers, else 0.", counts is not None)
        if counts is not None:
            _set_service_counts(rows, counts)
        return generate_latest(self._registry) + generate_latest(rows)


def _set_places(rows: CollectorRegistry, places: Places) -> None:
    words = "1 if the files of folds can be read and written, else 0."
    _set(rows, "storage_up", words, places.storage == OK)
    _set(rows, "disk_up", "1 if this machine's disk accepts uploads, else 0.", places.disk == OK)
    if places.free_bytes is not None:
        words = "Free space of the data directory's disk."
        _set(rows, "disk_free_bytes", words, places.free_bytes)


def _set_service_counts(rows: CollectorRegistry, counts: ServiceCounts) -> None:
    _set_counts(rows, "folds", "Folds by status.", "status", counts.folds)
    _set_counts(rows, "movies", "Movies by status.", "status", counts.movies)
    _set(rows, "queue_length", "Folds that wait for a worker.", counts.folds["queued"])
    words = "Waiting time of the fold that waits longest, s."
    _set(rows, "queue_oldest_seconds", words, counts.oldest_queued_s)
    _set(rows, "workers", "Live workers.", counts.workers)
    _set(rows, "storage_bytes", "Size of the files of all folds.", counts.storage_bytes)
    words = "Quantiles of the computing time of folds that ended within the last hour, s."
    last = len(counts.computed_s) - 1
    seconds = {
        f"{quantile:g}": counts.computed_s[min(int(quantile * (last + 1)), last)]
        for quantile in (0.5, 0.9, 1.0)
        if counts.computed_s
    }
    _set_counts(rows, "fold_seconds_lately", words, "quantile", seconds)
    words = "Number of folds that ended within the last hour; at most 500 are counted."
    _set(rows, "folds_ended_lately", words, len(counts.computed_s))
    words = "Number of folds that failed within the last hour, by error code."
    _set_counts(rows, "failures_lately", words, "code", counts.failures)


def _set(rows: CollectorRegistry, name: str, words: str, value: float) -> None:
    Gauge(f"foldback_{name}", words, registry=rows).set(value)


def _set_counts(
    rows: CollectorRegistry, name: str, words: str, label: str, counts: Mapping[str, float]
) -> None:
    gauge = Gauge(f"foldback_{name}", words, [label], registry=rows)
    for value, count in sorted(counts.items()):
        gauge.labels(value).set(count)
