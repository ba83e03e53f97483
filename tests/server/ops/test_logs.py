"""Logs: one line per event, regardless of what visitors send, with its context as fields."""

import io
import json
import logging
import re
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

from foldback.server.ops.logs import (
    ACCEPT_ERROR,
    AcceptErrors,
    JsonLines,
    TextLines,
    about,
    escaped,
)
from tests.server.service_process import FinishedFold, Service, wait_until

FORGED = 'x\n{"level": "error", "message": "forged"}\r\x1b[2K\u2028\x85'


class LogTail:
    """Log of a service in JSON from a moment on."""

    def __init__(self, service: Service) -> None:
        self.service = service
        self.http = service.http
        self.start_offset = service.log.stat().st_size

    @property
    def text(self) -> str:
        """Lines that were logged since then, without an incomplete last one."""
        return self.service.log.read_bytes()[self.start_offset :].rpartition(b"\n")[0].decode()


@pytest.fixture
def log_tail(service: Service) -> LogTail:
    """Log of the service with a worker from here on."""
    return LogTail(service)


def lines(log_tail: LogTail) -> list[dict[str, Any]]:
    return [json.loads(line) for line in log_tail.text.split("\n") if line]


def access(log_tail: LogTail, request_id: str) -> dict[str, Any]:
    """Wait for the log line of a request, which follows the answer, and return it."""

    def found() -> list[dict[str, Any]]:
        return [line for line in lines(log_tail) if line.get("request") == request_id]

    wait_until(found, lambda: log_tail.text)
    (line,) = found()
    assert line["logger"] == "foldback.access"
    return line


def capture(formatter: logging.Formatter, logger: logging.Logger) -> io.StringIO:
    """Return a stream of the lines that a logger writes from here on."""
    stream = io.StringIO()
    handler = logging.StreamHandler(stream)
    handler.setFormatter(formatter)
    logger.addHandler(handler)
    return stream


def test_lines_hold_the_fields_of_their_context() -> None:
    fields, logger = {"worker": "h/0"}, logging.Logger("foldback.test")
    as_json, as_text = (capture(kind(fields), logger) for kind in (JsonLines, TextLines))
    with about(fold="abc", request="r1"):
        logger.warning("%d of %d", 1, 2, extra={"movie": "m"})
        thread = threading.Thread(target=logger.info, args=("elsewhere",))
        thread.start()
        thread.join()
    logger.info("after")
    first, *other_records = (json.loads(line) for line in as_json.getvalue().splitlines())
    time = first.pop("time")
    assert time.endswith("Z") and "T" in time
    about_it = {"fold": "abc", "movie": "m", "worker": "h/0", "request": "r1"}
    log_tail = {"level": "warning", "logger": "foldback.test", "message": "1 of 2"}
    assert first == log_tail | about_it
    for record in other_records:
        assert "fold" not in record and record["worker"] == "h/0"
    assert "[fold=abc movie=m worker=h/0 request=r1]: 1 of 2" in as_text.getvalue()


def test_text_and_tracebacks_cannot_forge_lines() -> None:
    for kind in (JsonLines, TextLines):
        logger = logging.Logger("foldback.test")
        stream = capture(kind({}), logger)
        with about(fold=FORGED):
            logger.error("got %s", FORGED)
        (line,) = stream.getvalue().splitlines()
        assert line.isprintable()
        try:
            raise ValueError(FORGED)
        except ValueError:
            logger.exception("failed")
        _, first, *other_lines = stream.getvalue().split("\n")[:-1]
        assert "failed" in first and "Traceback" in stream.getvalue()
        assert all(line.startswith("  ") and line.isprintable() for line in other_lines)
    assert escaped("größer ≥ 3") == "größer ≥ 3"
    assert escaped("a\nb\x00\u202ec") == "a\\nb\\x00\\u202ec"


def test_request_leaves_one_line_with_its_route(log_tail: LogTail) -> None:
    answer = log_tail.http.get("/api/folds/abc123", headers={"X-Request-ID": "proxy-7.a"})
    assert answer.headers["x-request-id"] == "proxy-7.a"
    line = access(log_tail, "proxy-7.a")
    assert line["duration_ms"] >= 0
    assert (line["method"], line["status"], line["fold"]) == ("GET", 404, "abc123")
    assert line["route"] == "/api/folds/{fold_id}" and "path" not in line
    for odd in ("", "a b", "x" * 65, "<script>", "a;b", "a\tb"):
        answer = log_tail.http.get("/health", headers={"X-Request-ID": odd})
        header = answer.headers["x-request-id"]
        assert header != odd and header.isalnum() and len(header) == 32
        assert access(log_tail, header)["route"] == "/health"


def test_secrets_are_not_logged_in_requests(log_tail: LogTail) -> None:
    secret = {"Authorization": "Bearer very-secret-token-of-somebody", "Cookie": "a=very-secret-c"}
    for path, name in (("/api/folds", "secrets"), ("/nowhere", "no")):
        headers = secret | {"X-Request-ID": name}
        log_tail.http.get(f"{path}?token=very-secret-query", headers=headers)
    assert access(log_tail, "no")["path"] == "/nowhere"
    assert "secret-" not in log_tail.text


def test_requests_cannot_forge_lines(log_tail: LogTail) -> None:
    paths = ("/nowhere%0a%7b%22level%22:%22error%22%7d%0d%1b%5b2K", "/folds/a%0ab%E2%80%A8")
    ids = [log_tail.http.get(path).headers["x-request-id"] for path in (*paths, "/" + "n" * 5000)]
    computed_access = [access(log_tail, request_id) for request_id in ids]
    assert computed_access[0]["path"].startswith("/nowhere\n{")
    assert "fold" not in computed_access[1]
    assert len(computed_access[2]["path"]) == 200
    log_tail.http.request("FORGE", "/health", headers={"X-Request-ID": "odd"})
    assert access(log_tail, "odd")["method"] == "other"
    assert {line["level"] for line in lines(log_tail)} == {"info"}


def test_worker_logs_its_fold(finished: FinishedFold) -> None:
    log_tail = finished.service.log.read_text()
    words = ('"foldback.worker"', finished.id, "verified")
    (end,) = [line for line in log_tail.splitlines() if all(word in line for word in words)]
    assert re.fullmatch(r".+/[0-9a-f]{12}", json.loads(end)["worker"])
    assert finished.token not in log_tail


@pytest.mark.processes
def test_lines_below_the_level_are_left_out() -> None:
    code = """
import logging
from foldback.server.ops.logs import set_up_logs
from foldback.server.settings import Settings
for level in ("info", "error"):
    set_up_logs(Settings(log_level=level))
    logging.getLogger("foldback.access").info("small")
    logging.getLogger("foldback").error("big")
    logging.getLogger("alembic").warning("alien")
"""
    environment = {"PYTHONPATH": str(Path(__file__).parents[3])}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    log_tail = [line.rpartition(" ")[2] for line in done.stderr.splitlines()]
    assert log_tail == ["small", "big", "alien", "big"]


def test_errors_of_accepting_connections_are_logged_once_in_a_while() -> None:
    only_few = AcceptErrors()
    records: list[logging.LogRecord] = []
    for message in (ACCEPT_ERROR, "another error", ACCEPT_ERROR):
        error = (OSError, OSError(24, "Too many open files"), None)
        record = logging.LogRecord("asyncio", logging.ERROR, "", 0, message, (), error)
        if only_few.filter(record):
            records.append(record)
    assert [bool(record.exc_info) for record in records] == [False, True]
    assert "limit of open files" in records[0].getMessage()
