"""Supervisor: starts worker processes, and restarts those that die."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import subprocess
import sys
import threading
import time
from typing import Final

from server.settings import Settings

SUPERVISION_POLL_S: Final = 0.2
"""Time between two checks of the service's main process if a worker process has ended, in s. With a
larger value it is restarted later. Chosen."""
STOP_TIMEOUT_S: Final = 10.0
"""Time that the service's processes may take to stop when the service stops, in s; then they are
killed. A smaller value interrupts more requests and folds. Chosen."""
MAX_RESTART_PAUSE_S: Final = 30.0
"""Maximum pause before a worker process that ends again and again is restarted, in s; the pause
doubles from 0.5 s. A larger value resumes later after the cause is gone. Chosen."""
log = logging.getLogger("foldback.supervisor")


class Supervisor:
    """Worker processes, in the number of the settings.

    A worker ends when its standard input is closed, and thus also if this process is killed.
    """

    def __init__(self, settings: Settings) -> None:
        self._environment = {**os.environ, **environment_of_worker(settings)}
        self._workers: list[_Worker] = [_Worker() for _ in range(settings.workers)]
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._look_after, name="supervisor", daemon=True)

    def start(self) -> None:
        """Start all workers."""
        self._thread.start()

    def stop(self) -> None:
        """Stop all workers; their folds continue after the next start."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join()
        running = [w.process for w in self._workers if w.process is not None]
        for process in running:
            assert process.stdin is not None
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()
        deadline = time.monotonic() + STOP_TIMEOUT_S
        for process in running:
            try:
                process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def _look_after(self) -> None:
        while True:
            for worker in self._workers:
                worker.look(self._environment)
            if self._stopping.wait(SUPERVISION_POLL_S):
                return


class _Worker:
    """Worker process with restarts; the pause doubles if it dies soon after its start."""

    def __init__(self) -> None:
        self.process: subprocess.Popen[bytes] | None = None
        self._started = 0.0
        self._start_at = 0.0
        self._pause_s = 0.5

    def look(self, environment: dict[str, str]) -> None:
        now = time.monotonic()
        if self.process is not None and (code := self.process.poll()) is not None:
            lasted = now - self._started
            self._pause_s = 0.5 if lasted > 10.0 else min(2 * self._pause_s, MAX_RESTART_PAUSE_S)
            log.warning(
                "a worker ended (exit code %d); the next starts in %.1f s", code, self._pause_s
            )
            assert self.process.stdin is not None
            self.process.stdin.close()
            self.process = None
            self._start_at = now + self._pause_s
        if self.process is None and now >= self._start_at:
            self._started = now
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-m", "server.jobs.worker", "--leashed"],
                stdin=subprocess.PIPE,
                env=environment,
                # Ctrl-C in the terminal must reach only the service, which stops its workers.
                start_new_session=True,
            )


def environment_of_worker(settings: Settings) -> dict[str, str]:
    """Return settings as environment variables, without the secret that workers do not use."""
    given = settings.model_dump(mode="json", exclude={"metrics_token"}, exclude_none=True)
    return {
        f"FOLDBACK_{name.upper()}": json.dumps(value) if isinstance(value, list) else str(value)
        for name, value in given.items()
    }
