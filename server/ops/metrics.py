"""Metrics: figures of the service for Prometheus."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Final

from prometheus_client import CollectorRegistry, Gauge, Histogram, ProcessCollector, generate_latest
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector

from server.ops.readiness import OK, Places
from server.store.stats import Figures

METRICS_MEDIA_TYPE: Final = "text/plain; version=0.0.4; charset=utf-8"
BUCKETS_S: Final = (0.005, 0.01, 0.025, 0.05, 0.1, 0.15, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 60.0)
QUANTILES: Final = (0.5, 0.9, 1.0)


class Metrics:
    """Counters of the web process.

    Attributes:
        in_progress: Requests that are being answered.
    """

    def __init__(self) -> None:
        self._registry = CollectorRegistry()
        ProcessCollector(registry=self._registry)
        self._seconds = Histogram(
            "foldback_request_seconds",
            "Time to send a response; for event streams, the time until they are closed.",
            ("method", "route", "status"),
            buckets=BUCKETS_S,
            registry=self._registry,
        )
        self.in_progress = Gauge(
            "foldback_requests_in_progress",
            "Requests in progress, event streams included.",
            registry=self._registry,
        )
        self._websockets = Gauge(
            "foldback_websockets_open",
            "Open websockets of pages and robots.",
            registry=self._registry,
        )

    def count(self, *, method: str, route: str, status: int, seconds: float) -> None:
        """Count one HTTP answer."""
        self._seconds.labels(method, route, f"{status // 100}xx").observe(seconds)

    @contextmanager
    def websocket(self) -> Generator[None]:
        """Count a websocket for as long as it is open."""
        with self._websockets.track_inprogress():
            yield

    def text(self, figures: Figures | None, places: Places, *, streams: int, robots: int) -> bytes:
        """Return all figures, in the format that Prometheus reads.

        Args:
            figures: Figures of the rows; None if the database does not answer.
            places: State of disk and storage.
            streams: Number of open event streams.
            robots: Number of connected robots.
        """
        rows = CollectorRegistry(auto_describe=False)
        rows.register(
            _Families(
                *_open(streams=streams, robots=robots), *_of_places(places), *_of_rows(figures)
            )
        )
        return generate_latest(self._registry) + generate_latest(rows)


class _Families(Collector):
    """Metrics with the values of one moment."""

    def __init__(self, *families: GaugeMetricFamily) -> None:
        self._families = families

    def collect(self) -> Iterable[GaugeMetricFamily]:
        return self._families


def _open(*, streams: int, robots: int) -> Iterator[GaugeMetricFamily]:
    yield _gauge("streams_open", "Open event streams.", streams)
    yield _gauge("robots_open", "Connected robots.", robots)


def _of_places(places: Places) -> Iterator[GaugeMetricFamily]:
    words = "1 if the files of folds can be read and written, else 0."
    yield _gauge("storage_up", words, places.storage == OK)
    yield _gauge("disk_up", "1 if this machine's disk accepts uploads, else 0.", places.disk == OK)
    if places.free_bytes is not None:
        words = "Free space of the data directory's disk."
        yield _gauge("disk_free_bytes", words, places.free_bytes)


def _of_rows(found: Figures | None) -> Iterator[GaugeMetricFamily]:
    yield _gauge("database_up", "1 if the database answers, else 0.", found is not None)
    if found is None:
        return
    yield _counts("folds", "Folds by status.", "status", found.folds)
    yield _counts("movies", "Movies by status.", "status", found.movies)
    yield _gauge("queue_length", "Folds that wait for a worker.", found.folds["queued"])
    words = "Waiting time of the fold that waits longest, s."
    yield _gauge("queue_oldest_seconds", words, found.oldest_queued_s)
    yield _gauge("workers", "Live workers.", found.workers)
    yield _gauge("storage_bytes", "Size of the files of all folds.", found.storage_bytes)
    words = "Computing time of folds that ended within the last hour, s."
    last = len(found.computed_s) - 1
    seconds = {
        f"{quantile:g}": found.computed_s[min(int(quantile * (last + 1)), last)]
        for quantile in QUANTILES
        if found.computed_s
    }
    yield _counts("fold_seconds_lately", words, "quantile", seconds)
    words = "Folds that ended within the last hour, at most 500."
    yield _gauge("folds_ended_lately", words, len(found.computed_s))
    words = "Failed folds among those that ended within the last hour, by error code."
    yield _counts("failures_lately", words, "code", found.failures)


def _gauge(name: str, words: str, value: float) -> GaugeMetricFamily:
    return GaugeMetricFamily(f"foldback_{name}", words, value=value)


def _counts(name: str, words: str, label: str, counts: Mapping[str, float]) -> GaugeMetricFamily:
    family = GaugeMetricFamily(f"foldback_{name}", words, labels=[label])
    for value, count in sorted(counts.items()):
        family.add_metric([value], count)
    return family
