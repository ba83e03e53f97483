"""Worker: a process that takes folds from the queue and computes them, each exactly once.

A fold is a durable workflow: what a step returned is kept, so that after a crash it goes on with
the first step that has no result. The worker's name is what its unfinished folds are found by.
"""

from __future__ import annotations

import errno
import logging
import os
import secrets
import signal
import socket
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Final

from dbos import DBOS, DBOSConfig
from dbos import error as dbos_errors

from server.jobs.dbos_private import requeue_all, requeue_job, set_back, stop_dequeuing
from server.jobs.housekeeping import Housekeeping
from server.jobs.movie_runner import MovieJobs
from server.jobs.progress import STAGES
from server.jobs.queue import APPLICATION, APPLICATION_VERSION, MOVIE_WORKFLOW, WORKFLOW, Jobs
from server.jobs.runner import LeaseLostError, Outcome, Runner
from server.ops.logs import about, set_up_logs
from server.ops.starting import settings_of, starting, warn_of_unknown_names
from server.ops.tracing import send_rest, tracing
from server.processes.limits import keep_secrets
from server.settings import Settings
from server.store.folds import Store
from server.store.leases import Leases
from server.store.tables import passes
from server.store.worker_identity import WorkerIdentities

RECOVERY_POLL_S: Final = 2.0
"""Maximum time between two checks of a worker for expired workers and lost jobs, in s. With a
larger value a dead worker's folds continue later. Chosen."""
HEARTBEATS_PER_LEASE: Final = 5
"""Number of heartbeats that a worker sends within the lease time, without which it counts as dead.
A larger value tolerates more lost heartbeats and writes to the database more often. Chosen."""
RECOVERY_POLLS_PER_LEASE: Final = 8
"""Minimum number of checks for expired workers within the lease time, after which a worker without
heartbeats counts as dead. With a smaller value dead workers are noticed later. Chosen."""
ORPHANED_JOB_S: Final = 5.0
"""Time after which a job that is assigned to this worker, but that none of its threads processes,
is queued again, in s. A smaller value may queue a job that is just starting. Chosen."""
WORKER_SWEEP_S: Final = 60.0
"""Minimum time between two deletions of expired files and jobs by a worker, in s. A larger value
occupies the disk for longer. Chosen."""
COMPILING_REPORT_S: Final = 0.5
"""Time between two reports of a starting worker about the fraction of its numerical kernels that is
compiled, in s. A smaller value updates the displayed progress more often and writes more.
Chosen."""
MIN_JOBLESS_S: Final = 30.0
"""Time for which an unfinished fold may have no job in the queue, in s, before it counts as failed:
a new fold gets its database row before its job. A smaller value may fail new folds. Chosen."""
log = logging.getLogger("foldback.worker")


class Active:
    """The jobs that this process works on."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._jobs: Counter[str] = Counter()

    @contextmanager
    def working(self, job: str) -> Generator[None]:
        """Count a job for as long as it lasts."""
        with self._lock:
            self._jobs[job] += 1
        try:
            yield
        finally:
            with self._lock:
                self._jobs[job] -= 1

    def __contains__(self, job: str) -> bool:
        with self._lock:
            return self._jobs[job] > 0

    def __len__(self) -> int:
        with self._lock:
            return self._jobs.total()


class PutBack(BaseException):
    """End of an execution whose job goes on later.

    The job system notes the outcome of a job that ends with an ``Exception``, but not with this.
    """


def register(runner: Runner, movies: MovieJobs, name: str, active: Active) -> None:
    """Register the workflows: a fold is one step per stage and its end; and a movie."""

    def computed(fold_id: str, worker: str) -> Outcome:
        stage: str = STAGES[0]
        epoch = 0
        try:
            while True:
                outcome: Outcome = DBOS.run_step(
                    {"name": stage}, runner.run, fold_id, stage, worker, epoch
                )
                epoch = outcome["epoch"]
                if outcome.get("paused_by") == worker:  # else it goes on after a pause
                    runner.retry_until_available(
                        lambda: set_back(fold_id, name, *runner.place(fold_id))
                    )
                    raise PutBack
                if outcome["ended"] or outcome["following"] is None:
                    return outcome
                stage = outcome["following"]
        except Exception as error:
            if passes(error) or isinstance(error, LeaseLostError):
                raise
            log.exception("fold %s failed", fold_id)
            return {**runner.failure(error, stage), "epoch": epoch}

    def fold(fold_id: str) -> str:
        # The job system sees to it that of several executions only the last one has results.
        worker = f"{name}:{secrets.token_hex(6)}"
        with about(fold=fold_id), active.working(fold_id):
            try:
                outcome = computed(fold_id, worker)
                DBOS.run_step({"name": "finish"}, runner.finish, fold_id, outcome, worker)
            except Exception as error:
                # What was computed could not be noted, or another execution has come in between:
                # if the job is still ours it is done again.
                if passes(error) or isinstance(error, LeaseLostError):
                    log.warning("fold %s goes back to the queue: %s", fold_id, error)
                    with suppress(dbos_errors.DBOSWorkflowConflictIDError):
                        runner.retry_until_available(lambda: requeue_job(fold_id, name))
                raise
        return outcome["status"]

    def movie(fold_id: str, movie_id: str, job: str) -> None:
        with about(fold=fold_id, movie=movie_id), active.working(job):
            DBOS.run_step({"name": "film"}, movies.make, fold_id, movie_id, job)

    DBOS.workflow(name=WORKFLOW)(fold)
    DBOS.workflow(name=MOVIE_WORKFLOW)(movie)


def _hold_leash(on_end: Callable[[], None]) -> None:
    """Call back when standard input ends: the parent of this worker is gone."""

    def wait() -> None:
        while os.read(0, 1024):
            pass
        on_end()

    threading.Thread(target=wait, name="leash", daemon=True).start()


class _LeaseMonitor:
    """Heartbeat of this worker, and recovery of the jobs of expired ones."""

    def __init__(
        self,
        settings: Settings,
        store: Store,
        jobs: Jobs,
        runner: Runner,
        name: str,
        active: Active,
    ) -> None:
        self._settings = settings
        self._store = store
        self._jobs = jobs
        self._runner = runner
        self._name = name
        self._active = active
        self._leases = Leases.of(settings, store)
        self._housekeeping = Housekeeping(settings, store)
        self._orphans: dict[str, float] = {}
        self._preparing: float | None = -1.0  # what an earlier worker of this name noted is wrong
        self._swept_at = time.monotonic()

    def heartbeat(self) -> None:
        """Send a heartbeat of this worker."""
        at_once = self._settings.folds_per_worker
        self._leases.heartbeat(
            self._name, host=socket.gethostname()[:200], pid=os.getpid(), folds_at_once=at_once
        )

    def tell_preparing(self) -> None:
        """Note how far this worker has compiled its kernels; nothing once that is done."""
        fraction = self._runner.preparing()
        if fraction != self._preparing:
            self._leases.note_preparing(self._name, fraction)
            self._preparing = fraction

    def deregister(self) -> None:
        """Deregister this worker."""
        self._leases.deregister(self._name)

    def recover_and_sweep(self) -> None:
        """Requeue jobs of expired workers and orphaned ones; sweep if it is due."""
        running = DBOS.list_workflows(status="PENDING", load_input=False)
        holders = {str(job.executor_id) for job in running}
        for dead in self._leases.expired(holders) - {self._name}:
            if dead in holders:
                log.info("taking over the folds of %s", dead)
                requeue_all(dead)
            self._leases.deregister(dead)
        self._requeue_orphans(
            [str(job.workflow_id) for job in running if job.executor_id == self._name]
        )
        for row in self._jobs.reconcile(self._store, older_s=MIN_JOBLESS_S):
            log.error("fold %s: its job ended without a result", row.id, extra={"fold": row.id})
            outcome = self._runner.failure(RuntimeError("job"), row.stage)
            outcome["epoch"] = row.kept
            self._runner.finish(row.id, outcome, self._name)
        if time.monotonic() - self._swept_at >= WORKER_SWEEP_S:
            self._swept_at = time.monotonic()
            self._housekeeping.sweep()
            self._jobs.sweep(time.time())

    def _requeue_orphans(self, own: list[str]) -> None:
        """Queue this worker's orphaned jobs again.

        Not even that a step is over could be noted, for the disk was full or the database away.
        """
        now = time.monotonic()
        self._orphans = {job: self._orphans.get(job, now) for job in own if job not in self._active}
        for job, since in list(self._orphans.items()):
            if now - since >= ORPHANED_JOB_S:
                log.warning("job %s was dropped; it is queued again", job)
                requeue_job(job, self._name)
                del self._orphans[job]


def _repeat(stopping: threading.Event, every_s: float, do: Callable[[], None], what: str) -> None:
    """Repeat a call in a thread; log its errors."""

    def loop() -> None:
        while not stopping.wait(every_s):
            try:
                do()
            except Exception:
                log.exception("%s failed", what)

    threading.Thread(target=loop, name=what, daemon=True).start()


def _config(settings: Settings, worker: str) -> DBOSConfig:
    """Return the job system's configuration of a worker."""
    config: DBOSConfig = {
        "name": APPLICATION,
        "system_database_url": settings.queue_url,
        "application_version": APPLICATION_VERSION,
        "executor_id": worker,
        "log_level": "WARNING",
    }
    config.update(tracing(settings))
    return config


def work(settings: Settings, *, leashed: bool = False) -> None:
    """Process jobs until a signal, or the end of the parent process.

    After the first signal it takes no new jobs, continues for ``drain_s``, and returns unfinished
    jobs to the queue; after a second one it does so at once.

    Args:
        settings: The settings.
        leashed: True to end when standard input ends.
    """
    keep_secrets()
    set_up_logs(settings)
    if not leashed:  # who holds the leash has said so
        warn_of_unknown_names(log)
    with starting("worker"):
        if settings.read_only:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(settings.root))
        store = Store(settings)
        runner = Runner(settings, store)
        runner.prewarm()
        identity = WorkerIdentities(settings).take()
        set_up_logs(settings, worker=identity.name)
        jobs = Jobs(settings)
    told = threading.Semaphore(0)

    def tell(number: int = 0, frame: FrameType | None = None) -> None:
        told.release()

    def end() -> None:
        told.release(2)

    signal.signal(signal.SIGTERM, tell)
    signal.signal(signal.SIGINT, tell)
    if leashed:
        _hold_leash(end)
    DBOS(config=_config(settings, identity.name))
    active = Active()
    register(runner, MovieJobs(settings, store), identity.name, active)
    stopping = threading.Event()
    monitor = _LeaseMonitor(settings, store, jobs, runner, identity.name, active)
    monitor.heartbeat()
    monitor.tell_preparing()
    DBOS.launch()
    _repeat(stopping, COMPILING_REPORT_S, monitor.tell_preparing, "reporting compiled solvers")
    _repeat(
        stopping, settings.lease_s / HEARTBEATS_PER_LEASE, monitor.heartbeat, "sending heartbeats"
    )
    recovery_poll_s = min(RECOVERY_POLL_S, settings.lease_s / RECOVERY_POLLS_PER_LEASE)
    _repeat(stopping, recovery_poll_s, monitor.recover_and_sweep, "checking for expired workers")
    log.info("worker %s is ready", identity.name)
    told.acquire()
    stop_dequeuing()
    deadline = time.monotonic() + settings.drain_s
    while len(active) and time.monotonic() < deadline and not told.acquire(timeout=0.1):
        pass
    log.info("worker %s ends; %d jobs go back to the queue", identity.name, len(active))
    stopping.set()
    runner.stop()
    try:
        requeue_all(identity.name)
        monitor.deregister()
    except Exception:
        log.exception("jobs could not be put back; other workers will take them over")
    # Steps that were cut off must not get the time to note a result.
    send_rest(settings)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)


if __name__ == "__main__":
    work(settings_of(), leashed="--leashed" in sys.argv[1:])
