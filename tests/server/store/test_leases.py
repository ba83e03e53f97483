"""Liveness of workers: by counted heartbeats instead of dates, and by locks on their names."""

import subprocess
import sys
from pathlib import Path

import pytest

from foldback.server.settings import Settings
from foldback.server.store.folds import Store
from foldback.server.store.leases import Leases
from foldback.server.store.worker_identity import WorkerIdentities

LEASE_S = 15.0


class Clock:
    """Clock that advances only on request."""

    def __init__(self, now: float = 1000.0) -> None:
        self.now = now

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def leases(store: Store, tmp_path: Path, clock: Clock) -> Leases:
    return Leases(store, WorkerIdentities(Settings(data_dir=tmp_path)), LEASE_S, clock=clock)


def heartbeat(leases: Leases, name: str, pid: int = 1) -> None:
    leases.heartbeat(name, host="far away", pid=pid, folds_at_once=2)


def dead_after(leases: Leases, clock: Clock, seconds: float, *living: str) -> set[str]:
    """Return the workers that have expired at the end of a period with one check per second."""
    dead: set[str] = set()
    for _ in range(int(seconds)):
        clock.now += 1.0
        for name in living:
            heartbeat(leases, name)
        dead = leases.expired(())
    return dead


def test_worker_silent_for_a_lease_is_dead(leases: Leases, clock: Clock) -> None:
    for name in ("a/x/0", "b/x/0"):
        heartbeat(leases, name)
    assert leases.expired(()) == set()
    assert dead_after(leases, clock, LEASE_S - 1, "b/x/0") == set()
    assert dead_after(leases, clock, 2, "b/x/0") == {"a/x/0"}
    assert [row.name for row in leases.workers()] == ["b/x/0"]
    assert leases.at_once() == 2


def test_holder_of_folds_without_a_row_gets_a_lease(leases: Leases, clock: Clock) -> None:
    for _ in range(int(LEASE_S)):
        assert leases.expired(["unknown/x/3"]) == set()
        clock.now += 1.0
    assert leases.expired(["unknown/x/3"]) == {"unknown/x/3"}


def test_no_worker_dies_while_the_database_is_away(leases: Leases, clock: Clock) -> None:
    heartbeat(leases, "a/x/0")
    assert leases.expired(()) == set()
    clock.now += 10 * LEASE_S  # as if suspended: no heartbeats and no checks
    assert leases.expired(()) == set()
    assert dead_after(leases, clock, LEASE_S, "a/x/0") == set()


def test_worker_declared_dead_can_return(leases: Leases, clock: Clock) -> None:
    heartbeat(leases, "a/x/0")
    leases.expired(())
    assert dead_after(leases, clock, LEASE_S + 1) == {"a/x/0"}
    leases.deregister("a/x/0")
    assert leases.workers() == []
    heartbeat(leases, "a/x/0")
    assert leases.expired(()) == set()
    assert [row.name for row in leases.workers()] == ["a/x/0"]


def test_lock_reveals_dead_workers_of_this_machine_at_once(
    leases: Leases, tmp_path: Path, clock: Clock
) -> None:
    identities = WorkerIdentities(Settings(data_dir=tmp_path))
    living, identity = identities.take(), identities.take()
    assert living.name != identity.name
    for lease in (living, identity):
        heartbeat(leases, lease.name)
    assert leases.expired(()) == set()
    identity.lock.close()  # the kernel releases the lock when the process ends
    assert leases.expired(()) == {identity.name}
    assert identities.dead([living.name, identity.name, "another/machine/0"]) == {identity.name}
    living.lock.close()


PROBE = """
import sys
from pathlib import Path
from foldback.server.settings import Settings
from foldback.server.store.worker_identity import WorkerIdentities
identities = WorkerIdentities(Settings(data_dir=Path(sys.argv[1])))
print("begun", flush=True)
while True:
    identities.dead([sys.argv[2]])
"""


def test_probe_for_dead_workers_locks_no_name(tmp_path: Path) -> None:
    identities = WorkerIdentities(Settings(data_dir=tmp_path))
    identity = identities.take()
    identity.lock.close()
    probe = [sys.executable, "-c", PROBE, str(tmp_path), identity.name]
    with subprocess.Popen(probe, stdout=subprocess.PIPE) as probing:
        try:
            assert probing.stdout.readline() == b"begun\n"
            for _ in range(300):
                taken_s = identities.take()
                taken_s.lock.close()
                assert taken_s.name == identity.name
        finally:
            probing.kill()
