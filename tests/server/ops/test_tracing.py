"""Traces of folds: sent to the configured receiver, and to nothing by default."""

import http.server
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import ExportTraceServiceRequest

from foldback.server.ops import tracing
from foldback.server.ops.tracing import NoTracingError, span, start_tracing
from foldback.server.settings import Settings
from tests.run_python import run_python

CODE = """
from foldback.server.ops.tracing import send_rest, span, start_tracing
from foldback.server.settings import Settings
start_tracing(Settings())
with span("fold", fold_id="thefold"):
    for stage in ("read", "explode"):
        with span(stage):
            pass
send_rest()
"""


@pytest.fixture
def receiver() -> Iterator[tuple[str, list[ExportTraceServiceRequest]]]:
    """Address of an OTLP receiver, and the requests that it has received."""
    requests: list[ExportTraceServiceRequest] = []

    class Receiver(http.server.BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            assert self.path == "/v1/traces"
            body = self.rfile.read(int(self.headers["Content-Length"]))
            requests.append(ExportTraceServiceRequest.FromString(body))
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Receiver) as server:
        threading.Thread(target=server.serve_forever).start()
        yield f"http://127.0.0.1:{server.server_port}/v1/traces", requests
        server.shutdown()


@pytest.mark.slow
def test_fold_is_a_trace_with_a_span_for_each_stage(
    tmp_path: Path, receiver: tuple[str, list[ExportTraceServiceRequest]]
) -> None:
    endpoint, requests = receiver
    settings = {"FOLDBACK_DATA_DIR": str(tmp_path), "FOLDBACK_OTLP_ENDPOINT": endpoint}
    run_python("-c", CODE, **settings)
    resources = [resource for request in requests for resource in request.resource_spans]
    scopes = [scope for resource in resources for scope in resource.scope_spans]
    spans = [span for scope in scopes for span in scope.spans]
    named = {span.name: span for span in spans}
    assert {"fold", "read", "explode"} <= named.keys()
    assert named["read"].parent_span_id == named["fold"].span_id
    assert len({span.trace_id for span in spans}) == 1
    about = {attribute.key: attribute.value.string_value for attribute in named["fold"].attributes}
    assert about["fold_id"] == "thefold"


def test_tracing_is_off_by_default() -> None:
    start_tracing(Settings())
    with span("fold"):
        assert tracing._provider is None


def test_missing_packages_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "opentelemetry.sdk.trace", None)
    with pytest.raises(NoTracingError, match=r"foldback\[otel\]"):
        start_tracing(Settings(otlp_endpoint="http://127.0.0.1:4318/v1/traces"))
