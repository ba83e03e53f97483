from __future__ import annotations

import sqlite3
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from dbos import DBOSClient

from server.jobs.queue import JOB_RECORD_S, QUEUE, QUICK_QUEUE, Jobs, prepare
from server.limits.fair_queue import QUICK_FOLD_S
from server.settings import Settings
from tests.server.postgres import Postgres
from tests.server.rows import statements


def test_folds_are_taken_in_their_turn(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    turns = {"last": 70, "first": 0, "middle": 3}
    jobs = Jobs(settings)
    for fold_id, turn in turns.items():
        jobs.enqueue(fold_id, turn, QUICK_FOLD_S)
    jobs.close()
    client = DBOSClient(system_database_url=settings.queue_url)
    priorities = {job.workflow_id: job.priority for job in client.list_queued_workflows()}
    client.destroy()
    assert priorities.keys() == turns.keys()
    # The job system goes by rising priority; 0 would be none at all.
    assert 0 < priorities["first"] < priorities["middle"] < priorities["last"]  # type: ignore[operator]


def test_quick_folds_wait_in_a_queue_of_their_own(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    jobs = Jobs(settings)
    jobs.enqueue("quick", 0, QUICK_FOLD_S)
    jobs.enqueue("long", 0, QUICK_FOLD_S + 1.0)
    jobs.close()
    client = DBOSClient(system_database_url=settings.queue_url)
    queues = {job.workflow_id: job.queue_name for job in client.list_queued_workflows()}
    client.destroy()
    assert queues == {"quick": QUICK_QUEUE, "long": QUEUE}


def test_jobs_that_are_over_are_deleted_and_no_others_are_read(tmp_path: Path) -> None:
    jobs = Jobs(Settings(data_dir=tmp_path))
    for name in ("waits", "gone", "gone-too"):
        jobs.enqueue(name, 0, QUICK_FOLD_S)
    jobs.forget("gone")
    jobs.forget("gone-too")
    assert jobs.sweep(time.time()) == 0, "they are kept for a while"
    with statements() as said:
        assert jobs.sweep(time.time() + 2 * JOB_RECORD_S) == 2
    assert jobs.going(["waits", "gone", "gone-too"]) == {"waits": True}
    jobs.close()
    with sqlite3.connect(tmp_path / "jobs.db") as database:
        for table in ("workflow_status", "workflow_input", "workflow_output"):
            assert database.execute(f"SELECT count(*) FROM {table}").fetchone()[0] <= 1
        for statement, values in said:
            if "workflow" in statement:
                plan = database.execute(f"EXPLAIN QUERY PLAN {statement}", values).fetchall()
                assert not [line for line in plan if line[3].startswith("SCAN workflow")], statement
    database.close()


def test_processes_that_start_at_once_on_an_empty_database_do_not_wait_for_each_other(
    tmp_path: Path, postgres: Postgres
) -> None:
    """One creates indexes concurrently, for which PostgreSQL ends all other statements first."""
    settings = Settings(data_dir=tmp_path, database_url=postgres.database())
    threads = ThreadPoolExecutor(4)
    try:
        done = [threads.submit(prepare, settings) for _ in range(4)]
        assert [each.result(60.0) for each in done] == [None] * 4
    finally:
        threads.shutdown(wait=False, cancel_futures=True)
