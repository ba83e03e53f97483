"""Tracing: OpenTelemetry traces of a worker, with a span for each fold and each stage."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from foldback.server.settings import Settings

if TYPE_CHECKING:
    from opentelemetry.sdk.trace import TracerProvider

FLUSH_TIMEOUT_MS: Final = 2000
"""Maximum time that the end of a worker waits for unsent traces, in ms."""
_provider: TracerProvider | None = None


class NoTracingError(Exception):
    """The packages for traces are not installed."""


def start_tracing(settings: Settings) -> None:
    """Send the spans of this process to ``otlp_endpoint``; do nothing unless it is set.

    Raises:
        NoTracingError: If the packages are missing.
    """
    global _provider
    if settings.otlp_endpoint is None:
        return
    try:
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
        from opentelemetry.sdk.resources import Resource
        from opentelemetry.sdk.trace import TracerProvider
        from opentelemetry.sdk.trace.export import BatchSpanProcessor
    except ModuleNotFoundError as error:
        raise NoTracingError(
            "got FOLDBACK_OTLP_ENDPOINT without the packages that send traces: install "
            "'foldback[otel]', or unset the variable."
        ) from error
    _provider = TracerProvider(resource=Resource.create({"service.name": "foldback"}))
    exporter = OTLPSpanExporter(endpoint=settings.otlp_endpoint)
    _provider.add_span_processor(BatchSpanProcessor(exporter))


@contextmanager
def span(name: str, **attributes: str) -> Generator[None]:
    """Trace the code within a context; do nothing unless tracing was started."""
    if _provider is None:
        yield
        return
    with _provider.get_tracer("foldback").start_as_current_span(name, attributes=attributes):
        yield


def send_rest() -> None:
    """Send the remaining spans within ``FLUSH_TIMEOUT_MS``; called before the process ends."""
    if _provider is not None:
        _provider.force_flush(FLUSH_TIMEOUT_MS)
