"""A real service for tests, in a separate process: `foldback serve` with its workers."""

import json
import os
import queue
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import httpx
import psutil

TIMEOUT_S = 120.0
METRICS_TOKEN = "operator-token-of-tests"
KINDS = ("stages", "reader", "preparer", "movies", "retimer", "pictures")
"""Kinds of processes that compute."""
STAIRS = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [3, 1, 0], [3, 2, 0], [3, 3, 0], [4, 3, 0]]
"""Path of eight modules, which explodes quickly."""
SPIRAL = [
    *([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [-1, 1, 0], [-1, 0, 0], [-1, -1, 0], [0, -1, 0]),
    *([1, -1, 0], [2, -1, 0], [2, 0, 0], [2, 1, 0], [2, 2, 0], [1, 2, 0], [0, 2, 0], [-1, 2, 0]),
]
"""Path that crosses itself if it continues straight into its middle."""
SNAKE = [[x if y % 2 == 0 else 3 - x, y, 0] for y in range(4) for x in range(4)]


def path_file(cells: object, **extra: object) -> bytes:
    """Return the file of a path."""
    return json.dumps({"format": "foldback-path/1", "cells": cells, **extra}).encode()


class Service:
    """Service that can be started, stopped and restarted; ``http`` is a client of it.

    Args:
        data_dir: Directory for its data.
        environment: Additional environment variables, besides its settings.
        wrapper: Command that runs the service's.
        settings: Settings that differ from those of tests.
    """

    def __init__(
        self,
        data_dir: Path,
        *,
        environment: Mapping[str, str] | None = None,
        wrapper: tuple[str, ...] = (),
        **settings: object,
    ) -> None:
        self.wrapper = wrapper
        self.data_dir = data_dir
        self.log = data_dir.parent / f"{data_dir.name}.log"
        self.environment = {
            **{k: v for k, v in os.environ.items() if not k.startswith("FOLDBACK_")},
            "FOLDBACK_DATA_DIR": str(data_dir),
            "FOLDBACK_PORT": "0",
            # Machines that run tests are busy, and a lower priority would delay folds.
            "FOLDBACK_NICENESS": "0",
            # Few tests need all kinds of children, and each kind takes seconds to start.
            "FOLDBACK_PREWARM": "false",
            # Lists and counts start empty.
            "FOLDBACK_SHIPPED_FOLDS": "false",
            "FOLDBACK_METRICS_TOKEN": METRICS_TOKEN,
            # All visitors of a test have one address, unless it sets others.
            "FOLDBACK_REQUESTS_PER_SECOND_OF_VISITOR": "100000",
            "FOLDBACK_REQUESTS_AT_ONCE_OF_VISITOR": "1000000",
            "FOLDBACK_LISTS_PER_SECOND_OF_VISITOR": "100000",
            **{f"FOLDBACK_{name.upper()}": str(value) for name, value in settings.items()},
            **(environment or {}),
        }
        self.process: subprocess.Popen[str] | None = None
        self.http = httpx.Client()

    def launch(self, *arguments: str) -> "subprocess.Popen[str]":
        """Start the process, without waiting for the service."""
        with open(self.log, "a") as log:
            self.process = subprocess.Popen(
                [
                    *self.wrapper,
                    sys.executable,
                    "-P",
                    "-m",
                    "foldback.server.cli",
                    "serve",
                    *arguments,
                ],
                env=self.environment,
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
            )
        return self.process

    def start(self, *arguments: str) -> Self:
        self.launch(*arguments)
        lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._read, args=(self.process, lines), daemon=True).start()
        address = re.search(r"http://\S+", lines.get(timeout=TIMEOUT_S))
        assert address, self.log.read_text()
        self.http.close()
        self.http = httpx.Client(base_url=address.group(), timeout=60.0)
        return self

    @staticmethod
    def _read(process: subprocess.Popen[str], lines: queue.Queue[str]) -> None:
        assert process.stdout is not None
        with process.stdout:
            for line in process.stdout:
                lines.put(line)
        lines.put("")

    def stop(self) -> int:
        self.process.send_signal(signal.SIGTERM)
        self.http.close()
        return self.process.wait(TIMEOUT_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        assert self.stop() == 0

    def start_worker(self) -> subprocess.Popen[bytes]:
        """Start a worker that is not supervised."""
        with open(self.log, "a") as log:
            return subprocess.Popen(
                [sys.executable, "-P", "-m", "foldback.server.cli", "worker"],
                env=self.environment,
                stderr=log,
            )

    @contextmanager
    def worker(self) -> Iterator[subprocess.Popen[bytes]]:
        """Run a worker that is not supervised."""
        worker = self.start_worker()
        try:
            yield worker
        finally:
            worker.terminate()
            worker.wait(TIMEOUT_S)

    def wait_workers(self, count: int) -> None:
        wait_until(lambda: self.http.get("/ready").json()["workers"] == count, self.log.read_text)

    @property
    def netloc(self) -> str:
        """Host and port of its addresses."""
        return self.http.base_url.netloc.decode()

    def children(self, *kinds: str) -> list[psutil.Process]:
        """Return its processes that compute, whose names are their kinds."""
        return [child for kind in kinds or KINDS for child in self.processes(f"foldback {kind}")]

    def processes(self, module: str) -> list[psutil.Process]:
        """The processes of a module that this service has started."""
        path_rows = []
        for process in psutil.Process(self.process.pid).children(recursive=True):
            try:
                if module in process.cmdline():
                    path_rows.append(process)
            except psutil.NoSuchProcess:
                continue
        return path_rows

    def upload(
        self,
        filename: str,
        data: bytes | str | None,
        path: str = "/api/folds",
        /,
        *,
        token: str | None = None,
        **form: Any,
    ) -> httpx.Response:
        """Return the answer to a form with a file; without data, the file is omitted."""
        files = None if data is None else {"file": (filename, data)}
        headers = {} if token is None else bearer(token)
        return self.http.post(path, data=form, files=files, headers=headers)

    def fold(
        self, cells: object = None, /, *, token: str | None = None, **form: Any
    ) -> dict[str, Any]:
        """Request a fold of cells or a gallery shape, by a new visitor unless a token is given."""
        data = None if cells is None else json.dumps(cells)
        answer = self.upload("path.json", data, token=token, **form)
        assert answer.status_code == 202, answer.text
        return answer.json()

    def preview(
        self, filename: str = "", data: bytes | str | None = None, /, **form: Any
    ) -> dict[str, Any]:
        """Return the preview of a file, or of one that was uploaded before."""
        answer = self.upload(filename, data, "/api/shapes/preview", **form)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def refusal(self, **form: str) -> tuple[int, dict[str, Any]]:
        """Return the answer to a request without a file."""
        answer = self.http.post("/api/folds", data=form)
        return answer.status_code, answer.json()

    def directory(self, fold_id: str) -> Path:
        """Return the directory of a fold."""
        return self.data_dir / "folds" / fold_id

    def metrics(self) -> httpx.Response:
        """Return the operator's metrics."""
        return self.http.get("/metrics", headers=bearer(METRICS_TOKEN))

    def state(self, fold_id: str) -> dict[str, Any]:
        answer = self.http.get(f"/api/folds/{fold_id}")
        assert answer.status_code == 200, answer.text
        return answer.json()

    def wait(
        self, fold_id: str, until: Callable[[dict[str, Any]], bool], *, longest_s: float = 0.05
    ) -> dict[str, Any]:
        """Return the state of a fold once ``until`` is true; poll at least every ``longest_s``."""
        deadline = time.monotonic() + TIMEOUT_S
        pause = 0.02
        while not until(state := self.state(fold_id)):
            assert time.monotonic() < deadline, f"{state}\n{self.log.read_text()}"
            time.sleep(pause)
            pause = min(longest_s, 1.2 * pause)
        return state

    def wait_over(self, fold_id: str) -> dict[str, Any]:
        """Return the state of a finished fold. Each request takes 10 ms of the processor."""
        return self.wait(fold_id, over, longest_s=0.4)

    def wait_exploding(self, fold_id: str) -> dict[str, Any]:
        """Return the state of a fold when its explosion is visible."""
        return self.wait(
            fold_id,
            lambda s: over(s) or (s["stage"] == "explode" and s["progress"]["frames"] > 2),
        )

    def events(self, fold_id: str) -> Iterator[tuple[str, dict[str, Any]]]:
        with self.http.stream("GET", f"/api/folds/{fold_id}/events") as stream:
            assert stream.headers["content-type"].startswith("text/event-stream")
            name = ""
            for line in stream.iter_lines():
                if line.startswith("event: "):
                    name = line.removeprefix("event: ")
                elif line.startswith("data: "):
                    yield name, json.loads(line.removeprefix("data: "))


@dataclass(frozen=True)
class FinishedFold:
    """Verified fold: its service, the answer to its upload, its events and its final state."""

    service: Service
    accepted: dict[str, Any]
    events: list[tuple[str, dict[str, Any]]]
    state: dict[str, Any]

    @property
    def http(self) -> httpx.Client:
        return self.service.http

    @property
    def id(self) -> str:
        return self.accepted["id"]

    @property
    def token(self) -> str:
        """Token of its owner."""
        return self.accepted["owner_token"]

    @property
    def page(self) -> str:
        return f"/folds/{self.id}"

    @property
    def api(self) -> str:
        return f"/api/folds/{self.id}"

    @property
    def directory(self) -> Path:
        return self.service.directory(self.id)


def check_problem(answer: httpx.Response, status: int, code: str, *, retry: bool = False) -> str:
    """Check that an answer is a problem for programs, with a time to retry; return its detail."""
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert not retry or int(answer.headers["retry-after"]) > 0
    assert answer.json()["code"] == code, answer.text
    return answer.json()["detail"]


def wait_until(
    condition: Callable[[], object],
    report: Callable[[], object] = str,
    errors: tuple[type[Exception], ...] = (),
) -> None:
    """Wait until a condition is true, ignoring some errors; ``report`` explains a timeout."""
    deadline = time.monotonic() + TIMEOUT_S
    while True:
        with suppress(*errors):
            if condition():
                return
        assert time.monotonic() < deadline, report()
        time.sleep(0.02)


def over(state: dict[str, Any]) -> bool:
    return state["status"] in ("verified", "failed", "cancelled")


def owner(accepted: dict[str, Any]) -> dict[str, str]:
    """Return the headers of a fold's owner."""
    return bearer(accepted["owner_token"])


def bearer(token: str) -> dict[str, str]:
    """Return the headers of the holder of a token."""
    return {"Authorization": f"Bearer {token}"}
