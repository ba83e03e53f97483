"""Worker: a process that takes folds and movies from the queue and computes them.

It holds a lock as long as it lives, and puts jobs of workers without one back into the queue.
"""

from __future__ import annotations

import errno
import logging
import os
import threading
import time
from collections.abc import Callable
from functools import partial
from types import FrameType
from typing import Final

from foldback.server.jobs.dispatcher import Dispatcher
from foldback.server.jobs.housekeeping import Housekeeping
from foldback.server.jobs.movie_runner import MovieJobs
from foldback.server.jobs.queue import Queue
from foldback.server.jobs.runner import Runner
from foldback.server.ops.leash import Leash
from foldback.server.ops.logs import set_up_logs
from foldback.server.ops.startup_errors import starting, warn_of_unknown_names
from foldback.server.ops.stop_signals import on_stop_signals
from foldback.server.ops.tracing import send_rest, start_tracing
from foldback.server.processes.limits import keep_secrets
from foldback.server.settings import Settings
from foldback.server.store.folds import Store
from foldback.server.store.leases import Lease, Leases, new_worker_name

RECOVERY_POLL_S: Final = 0.4
"""Time between two searches for folds of dead workers, in s."""
SWEEP_S: Final = 60.0
"""Time between two searches for files and rows to delete, in s."""
SIGNAL_POLL_S: Final = 1.0
"""Maximum time until the main thread, which runs the handlers, notices a stop signal, in s. Linux
may deliver a signal to another thread, and then nothing wakes the main one."""
log = logging.getLogger("foldback.worker")


def recover(store: Store, queue: Queue, leases: Leases, lease: Lease) -> None:
    """Put the jobs of dead workers back into the queue."""
    holders = queue.holders()
    lost = holders - leases.living(holders)
    # Asked last: if all sessions have ended meanwhile, this worker's has, too.
    for dead in lost if lease.settled else ():
        log.info("taking over the folds of %s", dead)
        for fold_id, epoch in queue.hand_back_all(dead, lost=True):
            store.folders.leave(fold_id, epoch)


def _repeat(stopping: threading.Event, every_s: float, do: Callable[[], object], task: str) -> None:
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
        name = new_worker_name()
        set_up_logs(settings, worker=name)
        start_tracing(settings)
        queue, leases = Queue(store), Leases(settings, store)
        movies, at_once = MovieJobs(settings, store), settings.folds_per_worker
        dispatcher = Dispatcher(queue, runner, movies, worker=name, folds_at_once=at_once)
        lease = leases.take(name, on_notice=dispatcher.wake)
    signal_count = _signals(leash)
    stopping = threading.Event()
    dispatcher.start(lease)
    look = partial(recover, store, queue, leases, lease)
    _repeat(stopping, RECOVERY_POLL_S, look, "checking for dead workers")
    _repeat(stopping, SWEEP_S, Housekeeping(settings, store).sweep, "housekeeping")
    log.info("worker %s is ready", name)
    while not signal_count.acquire(timeout=SIGNAL_POLL_S):
        pass
    dispatcher.close()
    deadline = time.monotonic() + settings.drain_s
    while (
        dispatcher.active and time.monotonic() < deadline and not signal_count.acquire(timeout=0.1)
    ):
        pass
    log.info("worker %s ends; %d jobs go back to the queue", name, dispatcher.active)
    stopping.set()
    runner.stop()
    dispatcher.wait_idle(2.0)
    try:
        queue.hand_back_all(name, lost=False)
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
