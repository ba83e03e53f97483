"""Supervisor: starts worker processes, and restarts those that die or hang."""

from __future__ import annotations

import json
import logging
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable

from foldback.server.settings import Settings

log = logging.getLogger("foldback.supervisor")


class Supervisor:
    """Worker processes, in the number of the settings.

    A worker ends when its leash (``server.ops.leash``) is closed, and thus also if this process is
    killed. One that sends no pulses hangs, or was suspended, and is killed.
    """

    def __init__(self, settings: Settings) -> None:
        self._environment = {**os.environ, **environment_of_worker(settings)}
        self._workers = [SupervisedWorker(settings.lease_s) for _ in range(settings.workers)]
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
        for worker in self._workers:
            worker.release()
        deadline = time.monotonic() + 10.0
        for worker in self._workers:
            worker.stop(max(0.0, deadline - time.monotonic()))

    def _look_after(self) -> None:
        while not self._stopping.is_set():
            for worker in self._workers:
                worker.look(self._environment)
            self._stopping.wait(0.2)


class SupervisedWorker:
    """Worker process with restarts; the pause doubles if it dies soon after its start.

    Args:
        lease_s: Half of the time without a pulse after which the worker is killed, s.
        clock: Monotonic clock in seconds.
    """

    def __init__(self, lease_s: float, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self.process: subprocess.Popen[bytes] | None = None
        self.leash: socket.socket | None = None
        self._pulse_s = lease_s / 5
        # Loading a library can stop all threads of a process for a second.
        self._max_silent_s = max(2.0 * lease_s, 5.0)
        self._silent_s = 0.0
        self._looked_at = 0.0
        self._started = 0.0
        self._start_at = 0.0
        self._pause_s = 0.5

    def look(self, environment: dict[str, str]) -> None:
        """Start the worker if it has ended, and kill it if it hangs."""
        now = self._clock()
        if self.process is None:
            if now >= self._start_at:
                self._start(environment, now)
        elif (code := self.process.poll()) is not None:
            lasted = now - self._started
            self._pause_s = 0.5 if lasted > 10.0 else min(2 * self._pause_s, 30.0)
            log.warning(
                "a worker ended (exit code %d); the next starts in %.1f s", code, self._pause_s
            )
            self.release()
            self.process = None
            self._start_at = now + self._pause_s
        elif self._hangs(now):
            log.error("a worker has sent no pulse for %.0f s and is killed", self._silent_s)
            self._silent_s = 0.0
            self.process.kill()

    def release(self) -> None:
        """Close the leash: the worker ends."""
        if self.leash is not None:
            self.leash.close()

    def stop(self, timeout_s: float) -> None:
        """Release the worker and wait for its end; kill it after ``timeout_s``."""
        self.release()
        if self.process is None:
            return
        try:
            self.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def _start(self, environment: dict[str, str], now: float) -> None:
        self._started = self._looked_at = now
        self._silent_s = 0.0
        self.leash, child_end = socket.socketpair()
        self.leash.setblocking(False)
        with child_end:
            self.process = subprocess.Popen(
                [
                    sys.executable,
                    "-P",
                    "-m",
                    "foldback.server.jobs.worker_process",
                    str(self._pulse_s),
                ],
                stdin=child_end.fileno(),
                env=environment,
                # Ctrl-C in the terminal must reach only the service, which stops its workers.
                start_new_session=True,
            )

    def _hangs(self, now: float) -> bool:
        """Return True if the worker has sent no pulse for too long."""
        assert self.leash is not None
        try:
            heard = bool(self.leash.recv(65536))
        except BlockingIOError:
            heard = False
        # If this process was suspended, too, as with the whole machine, that time does not count.
        passed_s = min(now - self._looked_at, 1.0)
        self._looked_at = now
        self._silent_s = 0.0 if heard else self._silent_s + passed_s
        return self._silent_s > self._max_silent_s


def environment_of_worker(settings: Settings) -> dict[str, str]:
    """Return settings as environment variables, without the secret that workers do not use."""
    values = settings.model_dump(mode="json", exclude={"metrics_token"}, exclude_none=True)
    return {
        f"FOLDBACK_{name.upper()}": json.dumps(value) if isinstance(value, list) else str(value)
        for name, value in values.items()
    }
