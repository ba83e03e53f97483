from __future__ import annotations

from pathlib import Path

from dbos import DBOSClient

from server.jobs.queue import Jobs
from server.settings import Settings


def test_folds_are_taken_in_their_turn(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    turns = {"last": 70, "first": 0, "middle": 3}
    jobs = Jobs(settings)
    for fold_id, turn in turns.items():
        jobs.enqueue(fold_id, turn)
    jobs.close()
    client = DBOSClient(system_database_url=settings.queue_url)
    priorities = {job.workflow_id: job.priority for job in client.list_queued_workflows()}
    client.destroy()
    assert priorities.keys() == turns.keys()
    # The job system goes by rising priority; 0 would be none at all.
    assert 0 < priorities["first"] < priorities["middle"] < priorities["last"]  # type: ignore[operator]
