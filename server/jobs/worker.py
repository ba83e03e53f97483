"""Worker: a process that takes folds and movies from the queue and computes them.

It sends heartbeats, and puts jobs of workers without heartbeats back into the queue.
"""

from __future__ import annotations

import errno
import logging
import os
import socket
import threading
import time
from collections.abc import Callable
from types import FrameType

from foldback.server.jobs.dispatcher import Dispatcher
from foldback.server.jobs.housekeeping import Housekeeping
from foldback.server.jobs.movie_runner import MovieJobs
from foldback.server.jobs.queue import Lane, Queue
from foldback.server.jobs.runner import Runner
from foldback.server.ops.leash import Leash
from foldback.server.ops.logs import set_up_logs
from foldback.server.ops.startup_errors import starting, warn_of_unknown_names
from foldback.server.ops.stop_signals import on_stop_signals
from foldback.server.ops.tracing import send_rest, start_tracing
from foldback.server.processes.limits import keep_secrets
from foldback.server.settings import Settings
from foldback.server.store.folds import Store
from foldback.server.store.leases import Leases
from foldback.server.store.worker_identity import WorkerIdentities

log = logging.getLogger("foldback.worker")


class _LeaseMonitor:
    """Heartbeat of this worker, and recovery of the jobs of expired ones."""

    def __init__(self, settings: Settings, store: Store, queue: Queue, name: str) -> None:
        self._settings = settings
        self._store = store
        self._queue = queue
        self._name = name
        self._leases = Leases.of(settings, store)
        self._housekeeping = Housekeeping(settings, store)
        self._swept_at = time.monotonic()

    def heartbeat(self) -> None:
        """Send a heartbeat of this worker."""
        at_once = self._settings.folds_per_worker
        self._leases.heartbeat(
            self._name, host=socket.gethostname()[:200], pid=os.getpid(), folds_at_once=at_once
        )

    def deregister(self) -> None:
        """Deregister this worker."""
        self._leases.deregister(self._name)

    def take_back(self, worker: str) -> None:
        """Put the jobs of a worker that has died back into the queue."""
        for fold_id, epoch in self._queue.hand_back_all(worker, lost=True):
            self._store.folders.leave(fold_id, epoch)

    def recover_and_sweep(self) -> None:
        """Put jobs of expired workers back into the queue; sweep if due."""
        holders = self._queue.holders()
        for dead in self._leases.expired(holders) - {self._name}:
            if dead in holders:
                log.info("taking over the folds of %s", dead)
                self.take_back(dead)
            self._leases.deregister(dead)
        if time.monotonic() - self._swept_at >= 60.0:
            self._swept_at = time.monotonic()
            self._housekeeping.sweep()


def _repeat(stopping: threading.Event, every_s: float, do: Callable[[], None], task: str) -> None:
    """Repeat a call in a thread; log its errors."""

    def loop() -> None:
        while not stopping.wait(every_s):
            try:
                do()
            except Exception:
                log.exception("%s failed", task)

    threading.Thread(target=loop, name=task, daemon=True).start()


def work(settings: Settings, *, leash: Leash | None = None) -> None:
    """Process jobs until a signal, or the end of the parent process.

    After the first signal it takes no new jobs, continues for ``drain_s``, and returns unfinished
    jobs to the queue; after a second one it does so at once.

    Args:
        settings: The settings.
        leash: Connection to the parent process, if it ends with this process.
    """
    keep_secrets()
    set_up_logs(settings)
    if leash is None:  # otherwise the parent process has already warned
        warn_of_unknown_names(log)
    with starting("worker"):
        if settings.read_only:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(settings.root))
        store = Store(settings)
        runner = Runner(settings, store)
        runner.prewarm()
        identity = WorkerIdentities(settings).take()
        set_up_logs(settings, worker=identity.name)
        start_tracing(settings)
        queue = Queue(store)
        monitor = _LeaseMonitor(settings, store, queue, identity.name)
        monitor.take_back(identity.name)  # jobs of an earlier process of this name
    signal_count = _signals(leash)
    dispatcher = Dispatcher(
        queue,
        runner,
        MovieJobs(settings, store),
        worker=identity.name,
        places={
            Lane.LONG: settings.folds_per_worker,
            Lane.QUICK: settings.folds_per_worker,
            # One at a time: software OpenGL and the encoder occupy all cores of a small machine.
            Lane.MOVIES: 1,
        },
    )
    stopping = threading.Event()
    monitor.heartbeat()
    dispatcher.start()
    _repeat(stopping, settings.lease_s / 5, monitor.heartbeat, "sending heartbeats")
    recovery_poll_s = min(2.0, settings.lease_s / 8)
    _repeat(stopping, recovery_poll_s, monitor.recover_and_sweep, "checking for expired workers")
    log.info("worker %s is ready", identity.name)
    signal_count.acquire()
    dispatcher.close()
    deadline = time.monotonic() + settings.drain_s
    while (
        dispatcher.active and time.monotonic() < deadline and not signal_count.acquire(timeout=0.1)
    ):
        pass
    log.info("worker %s ends; %d jobs go back to the queue", identity.name, dispatcher.active)
    stopping.set()
    runner.stop()
    dispatcher.wait_idle(2.0)
    try:
        queue.hand_back_all(identity.name, lost=False)
        monitor.deregister()
    except Exception:
        log.exception("jobs could not be returned to the queue; other workers will take them over")
    send_rest()


def _signals(leash: Leash | None) -> threading.Semaphore:
    """Return a semaphore, released once per stop signal, and twice if the leash ends."""
    signal_count = threading.Semaphore(0)

    def tell(_number: int, _frame: FrameType | None) -> None:
        signal_count.release()

    on_stop_signals(tell)
    if leash is not None:
        leash.on_end = lambda: signal_count.release(2)
    return signal_count
