"""Jobs: how the server hands folds to the workers.

The queue is durable and lives in its own tables; the server only puts folds in and takes them out,
the workers (``server/jobs/worker.py``) compute.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Generator
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

import sqlalchemy as sa
from dbos import DBOS, DBOSClient, EnqueueOptions

from server.limits.fair_queue import is_quick
from server.settings import Settings

if TYPE_CHECKING:
    from server.store.folds import Store
    from server.store.tables import FoldRow

APPLICATION: Final = "foldback"
# Fixed: jobs that wait go on after an update; the workflow's steps keep their meaning.
APPLICATION_VERSION: Final = "1"
QUEUE: Final = "folds"
QUICK_QUEUE: Final = "quick-folds"
"""Name of the queue of folds that are expected to take little time. Every worker computes a number
of them besides those of the other queue, so that they do not wait for long folds."""
WORKFLOW: Final = "fold"
MOVIES_QUEUE: Final = "movies"
MOVIE_WORKFLOW: Final = "movie"
ACTIVE_JOB_STATES: Final = frozenset({"ENQUEUED", "DELAYED", "PENDING"})
"""Job states of DBOS, the job system, in which a worker computes the job or will do so."""
QUEUE_POLL_S: Final = 0.2
"""Time between two checks of a worker for waiting folds, in s, in each of two queues. A fold waits
half of it on average. A smaller value takes more processor time while there is nothing to do: 4 to
5 % of a core at this value, together with 1 s for movies. Chosen."""
MOVIE_POLL_S: Final = 1.0
"""Time between two checks of a worker for waiting movies, in s. A movie waits half of it on
average; a smaller value takes more processor time while there is nothing to do. Chosen."""
JOBS_PER_BATCH: Final = 500
"""Maximum number of ended jobs that are read and deleted at once in the job system's tables. A
larger value locks the tables for longer; a smaller one needs more queries. Chosen."""
MAX_JOB_BATCHES: Final = 20
"""Maximum number of batches of ended jobs that one sweep deletes; later sweeps delete the rest. A
larger value delays the worker's other duties. Chosen."""
JOB_RECORD_S: Final = 3600.0
"""Time for which the job system keeps the record of an ended job, in s. It must exceed the time
between checks for failed jobs; a larger value makes the job tables larger. Chosen."""
# A job ends so when not even its end could be noted, or when it took its worker along every time.
FAILED_JOB_STATES: Final = ("ERROR", "MAX_RECOVERY_ATTEMPTS_EXCEEDED")
ENDED_JOB_STATES: Final = frozenset({"SUCCESS", "CANCELLED", *FAILED_JOB_STATES})
JOB_TABLES_LOCK: Final = 0x666F6C64
"""Key of the advisory lock of PostgreSQL that a process holds while it creates the job system's
tables, so that two processes never do so at the same time. Any number that no other lock uses."""
JOB_TABLES_POLL_S: Final = 0.2
"""Time between two attempts to acquire that lock, in s. A larger value delays the start of several
processes at once; a smaller one asks PostgreSQL more often. Chosen."""


def place_of(turn: int, cost_s: float) -> tuple[str, int]:
    """Return the queue and the priority of a fold; the least priority above 0 comes first."""
    return QUICK_QUEUE if is_quick(cost_s) else QUEUE, turn + 1


def prepare(settings: Settings) -> None:
    """Migrate the job system's tables to their newest schema and register the queues."""
    url = settings.queue_url
    if url.startswith("sqlite"):
        engine = sa.create_engine(url)
        with engine.connect() as connection:
            connection.exec_driver_sql("PRAGMA journal_mode=WAL")
        engine.dispose()
    with _alone(url):
        DBOS.migrate(url)
        _register(settings)


def _register(settings: Settings) -> None:
    client = _client(settings)
    try:
        for name in (QUEUE, QUICK_QUEUE):
            client.register_queue(
                name,
                worker_concurrency=settings.folds_per_worker,
                polling_interval_sec=QUEUE_POLL_S,
            )
        # One at a time: software OpenGL and the encoder keep all cores of a small machine busy.
        client.register_queue(MOVIES_QUEUE, worker_concurrency=1, polling_interval_sec=MOVIE_POLL_S)
    finally:
        client.destroy()


@contextlib.contextmanager
def _alone(url: str) -> Generator[None]:
    """Lock out others that would create the same tables at the same time."""
    if not url.startswith("postgresql"):
        yield
        return
    # The job system creates indexes concurrently, in another connection. They wait for the end of
    # every transaction, and of every statement: also of one that waits for this lock.
    engine = sa.create_engine(url, isolation_level="AUTOCOMMIT")
    try:
        with engine.connect() as connection:
            while not connection.scalar(sa.select(sa.func.pg_try_advisory_lock(JOB_TABLES_LOCK))):
                time.sleep(JOB_TABLES_POLL_S)
            yield
    finally:
        engine.dispose()  # and with the connection goes the lock


def _client(settings: Settings) -> DBOSClient:
    # Who asks is told that the database is away; a job that got lost so is found by the workers.
    return DBOSClient(
        system_database_url=settings.queue_url,
        application_name=APPLICATION,
        retry_connection_errors=False,
        lazy=settings.read_only,
    )


class Jobs:
    """The server's end of the queue."""

    def __init__(self, settings: Settings) -> None:
        if not settings.read_only:
            prepare(settings)
        self._client = _client(settings)

    def close(self) -> None:
        """Close the database."""
        self._client.destroy()

    def enqueue(self, fold_id: str, turn: int, cost_s: float) -> None:
        """Put a fold into the queue of its lane, in its turn; do nothing if it is there."""
        queue, priority = place_of(turn, cost_s)
        options: EnqueueOptions = {
            "workflow_name": WORKFLOW,
            "queue_name": queue,
            "workflow_id": fold_id,
            "app_version": APPLICATION_VERSION,
            "priority": priority,
        }
        self._client.enqueue(options, fold_id)

    def forget(self, fold_id: str) -> None:
        """Remove a fold that has not started from the queue."""
        # One that runs is stopped by its row; here it must be left to come to its own end.
        with contextlib.suppress(Exception):
            status = self._client.retrieve_workflow(fold_id).get_status()
            if status.status == "ENQUEUED":
                self._client.cancel_workflow(fold_id)

    def enqueue_movie(self, job: str, fold_id: str, movie_id: str) -> None:
        """Enqueue a movie under a unique name."""
        options: EnqueueOptions = {
            "workflow_name": MOVIE_WORKFLOW,
            "queue_name": MOVIES_QUEUE,
            "workflow_id": job,
            "app_version": APPLICATION_VERSION,
        }
        self._client.enqueue(options, fold_id, movie_id, job)

    def going(self, jobs: list[str]) -> dict[str, bool]:
        """Return for each known job whether it is waiting or running."""
        found = self._client.list_workflows(workflow_ids=jobs, load_input=False, load_output=False)
        return {str(job.workflow_id): job.status in ACTIVE_JOB_STATES for job in found}

    def sweep(self, now: float) -> int:
        """Delete jobs that are over and were asked for more than ``JOB_RECORD_S`` ago.

        Returns:
            Number of jobs that were deleted.
        """
        before = datetime.fromtimestamp(now - JOB_RECORD_S, UTC).isoformat()
        gone = 0
        for _ in range(MAX_JOB_BATCHES):
            over = self._client.list_workflows(
                status=sorted(ENDED_JOB_STATES),
                end_time=before,
                limit=JOBS_PER_BATCH,
                load_input=False,
                load_output=False,
            )
            if over:
                self._client.delete_workflows([str(job.workflow_id) for job in over])
            gone += len(over)
            if len(over) < JOBS_PER_BATCH:
                break
        return gone

    def reconcile(self, store: Store, *, older_s: float = 0.0) -> list[FoldRow]:
        """Enqueue folds that have a row and no job, after a crash between the two.

        Args:
            store: Store with the rows.
            older_s: Minimum age of a row, s; a new one has no job yet.

        Returns:
            Folds that are not over though their job is, which has failed without a word.
        """
        rows = store.unfinished()
        states: dict[str, str] = {}
        for first in range(0, len(rows), JOBS_PER_BATCH):
            some = [row.id for row in rows[first : first + JOBS_PER_BATCH]]
            found = self._client.list_workflows(
                workflow_ids=some, load_input=False, load_output=False
            )
            states.update({str(job.workflow_id): str(job.status) for job in found})
        for row in rows:
            if row.id not in states and time.time() - row.created_at >= older_s:
                self.enqueue(row.id, row.turn, row.cost_s)
        return [row for row in rows if states.get(row.id) in FAILED_JOB_STATES]
