"""Tracing: the folds of a worker as OpenTelemetry traces, a span a fold and one a stage."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Final

from dbos import DBOSConfig

from server.settings import Settings

TRACING_PACKAGES: Final = (
    "opentelemetry.sdk",
    "opentelemetry.exporter.otlp.proto.http",
    "opentelemetry.instrumentation.logging",
)
FLUSH_TIMEOUT_MS: Final = 2000


class NoTracingError(Exception):
    """The packages for traces are not installed."""


def tracing(settings: Settings) -> DBOSConfig:
    """Return the job system's options for traces; none unless ``otlp_endpoint`` is set.

    Raises:
        NoTracingError: When the packages are missing.
    """
    if settings.otlp_endpoint is None:
        return DBOSConfig()
    if any(not _there(name) for name in TRACING_PACKAGES):
        raise NoTracingError(
            "got FOLDBACK_OTLP_ENDPOINT without the packages that send traces: install "
            "'foldback[otel]', or unset it."
        )
    return DBOSConfig(enable_otlp=True, otlp_traces_endpoints=[settings.otlp_endpoint])


def send_rest(settings: Settings) -> None:
    """Send what waits to be sent, within ``FLUSH_TIMEOUT_MS``; for a process that ends at once."""
    if settings.otlp_endpoint is None:
        return
    from opentelemetry.sdk.trace import TracerProvider
    from opentelemetry.trace import get_tracer_provider

    provider = get_tracer_provider()
    if isinstance(provider, TracerProvider):
        provider.force_flush(FLUSH_TIMEOUT_MS)


def _there(name: str) -> bool:
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:
        return False
