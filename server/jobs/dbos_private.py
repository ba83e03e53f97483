"""Private names of dbos: what its public ones cannot do, in one place.

Its version is pinned, and ``tests/server/jobs/test_dbos_private.py`` says which name has gone.
"""

# pyright: reportPrivateUsage=false
from __future__ import annotations

import sqlalchemy as sa
from dbos import DBOS
from dbos._context import current_owner_xid
from dbos._dbos import _get_dbos_instance
from dbos._migration import get_migration_versions, get_sqlite_migration_versions
from dbos._utils import INTERNAL_QUEUE_NAME


def requeue_job(job: str, worker: str) -> None:
    """Return one job of a worker to its queue.

    Raises:
        DBOSWorkflowConflictIDError: When the execution that asks has lost the job to another.
    """
    system = _get_dbos_instance()._sys_db
    if (owner := current_owner_xid(job)) is not None:
        with system.engine.begin() as connection:
            system._check_owner_txn(connection, job, owner)
    system.reenqueue_for_recovery(job, [worker], INTERNAL_QUEUE_NAME)


def set_back(job: str, worker: str, queue: str, priority: int) -> None:
    """Put a job that a worker holds into a queue, at a place of its own."""
    system = _get_dbos_instance()._sys_db
    jobs = system.tables.workflow_status
    held = (*system._wf(jobs, job), jobs.c.status == "PENDING", jobs.c.executor_id == worker)
    with system.engine.begin() as connection:
        connection.execute(
            sa.update(jobs)
            .where(*held)
            .values(
                status="ENQUEUED",
                owner_xid=None,
                started_at_epoch_ms=None,
                updated_at=system._now_ms_sql(),
                queue_name=queue,
                priority=priority,
                recovery_attempts=0,
            )
        )


def requeue_all(worker: str) -> None:
    """Return all jobs of a worker to their queues."""
    DBOS._recover_pending_workflows([worker])


def stop_dequeuing() -> None:
    """Stop this process from taking jobs; its current ones continue."""
    for polling in _get_dbos_instance().background_thread_stop_events:
        polling.set()


def job_table_versions(engine: sa.Engine) -> tuple[int, int]:
    """Return the version of the job system's tables, and the newest known one; 0 if none exist."""
    if engine.dialect.name == "sqlite":
        return get_sqlite_migration_versions(engine)
    return get_migration_versions(engine, "dbos", True)
