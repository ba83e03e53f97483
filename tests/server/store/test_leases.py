"""Leases: workers live as long as their locks, in a file or in a session."""

import os
import subprocess
import sys
from collections.abc import Collection
from contextlib import ExitStack
from pathlib import Path

import pytest
import sqlalchemy as sa

from foldback.server.settings import Settings
from foldback.server.store.folds import Store
from foldback.server.store.leases import FileLease, Leases
from foldback.server.store.schema import WorkerRow
from tests.server.rows import live_worker
from tests.server.service_process import wait_until


@pytest.fixture
def leases(each_settings: Settings, each_store: Store) -> Leases:
    return Leases(each_settings, each_store)


def test_workers_live_as_long_as_their_locks(leases: Leases, each_store: Store) -> None:
    names = ["a/1", "b/2", "c/3"]
    with live_worker(leases, "b/2"):
        with live_worker(leases, "a/1"):
            assert leases.living(names) == {"a/1", "b/2"}
            assert [worker.name for worker in leases.workers()] == ["a/1", "b/2"]
            assert leases.at_once() == 2
        wait_until(lambda: leases.living(names) == {"b/2"})
        assert [worker.name for worker in leases.workers()] == ["b/2"]
        with live_worker(leases, "c/3"):
            assert sorted(each_store.scalars(sa.select(WorkerRow.name))) == ["b/2", "c/3"]


def test_workers_that_register_at_once_keep_their_rows(
    leases: Leases, monkeypatch: pytest.MonkeyPatch
) -> None:
    living = leases.living
    with ExitStack() as workers:

        def register_meanwhile(names: Collection[str]) -> set[str]:
            monkeypatch.undo()
            earlier = living(names)
            workers.enter_context(live_worker(leases, "a/1"))
            return earlier

        monkeypatch.setattr(leases, "living", register_meanwhile)
        workers.enter_context(live_worker(leases, "b/2"))
        wait_until(lambda: [worker.name for worker in leases.workers()] == ["a/1", "b/2"])


PROBE = """
import sys
from pathlib import Path
from foldback.server.store.leases import FileLease
print("begun", flush=True)
for k in range(10**9):
    FileLease(Path(sys.argv[1]) / f"probe{k}")
"""


def test_starting_workers_take_no_lock_from_each_other(tmp_path: Path) -> None:
    """Each looks for the locks of all others, and deletes the files of dead ones."""
    place = tmp_path / "workers"
    probe = [sys.executable, "-c", PROBE, str(place)]
    with subprocess.Popen(probe, stdout=subprocess.PIPE) as probing:
        try:
            assert probing.stdout.readline() == b"begun\n"
            held = [FileLease(place / f"{k}") for k in range(100)]
        finally:
            probing.kill()
    held.append(FileLease(place / "last"))
    files = {path.name for path in place.glob("[!.]*")}
    assert files == {"last", *(f"{k}" for k in range(100))}  # the dead ones are gone
    for lease in held:
        os.close(lease.descriptor)
