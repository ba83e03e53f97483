"""Metrics: counters of the service in Prometheus' text format."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Mapping

import psutil
from starlette.types import ASGIApp, Message, Receive, Scope, Send


class Metrics:
    """What the web process counts."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._answers: Counter[str] = Counter()
        self._started = time.time()

    def count_answer(self, status: int) -> None:
        """Counts one HTTP answer by the class of its status."""
        with self._lock:
            self._answers[f"{status // 100}xx"] += 1

    def text(self, folds: Mapping[str, int]) -> str:
        """All figures, in the format that Prometheus reads."""
        with self._lock:
            answers = dict(self._answers)
        lines = [
            "# HELP foldback_folds Folds by status.",
            "# TYPE foldback_folds gauge",
            *(f'foldback_folds{{status="{s}"}} {n}' for s, n in sorted(folds.items())),
            "# HELP foldback_http_answers_total HTTP answers by class of status.",
            "# TYPE foldback_http_answers_total counter",
            *(f'foldback_http_answers_total{{status="{s}"}} {n}' for s, n in answers.items()),
            "# HELP process_resident_memory_bytes Memory of the web process.",
            "# TYPE process_resident_memory_bytes gauge",
            f"process_resident_memory_bytes {psutil.Process().memory_info().rss}",
            "# HELP process_start_time_seconds When the web process started.",
            "# TYPE process_start_time_seconds gauge",
            f"process_start_time_seconds {self._started:.3f}",
        ]
        return "\n".join(lines) + "\n"


class CountAnswers:
    """Counts every HTTP answer as it starts."""

    def __init__(self, app: ASGIApp, *, metrics: Metrics) -> None:
        self._app = app
        self._metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handles one request."""

        async def send_counted(message: Message) -> None:
            if message["type"] == "http.response.start":
                self._metrics.count_answer(message["status"])
            await send(message)

        await self._app(scope, receive, send_counted if scope["type"] == "http" else send)
