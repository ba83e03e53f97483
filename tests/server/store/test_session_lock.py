"""Locks of sessions: they end with their process, their lease, or PostgreSQL, and come back."""

import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager

import pytest
import sqlalchemy as sa

from foldback.server.settings import Settings
from foldback.server.store.schema import engine_for
from foldback.server.store.session_lock import SessionLock, held_names
from tests.server.postgres import Postgres
from tests.server.service_process import TIMEOUT_S

pytestmark = pytest.mark.processes
LEASE_S = 1.0
HOLDER = """
import sys
from foldback.server.store.session_lock import SessionLock
lock = SessionLock(sys.argv[1], "name", float(sys.argv[2]))
lock.wait()
print("taken", flush=True)
sys.stdin.readline()
print(lock.held)
"""


@pytest.fixture
def url(postgres: Postgres) -> str:
    return Settings(database_url=postgres.url("postgres")).store_url


@pytest.fixture
def engine(url: str) -> Iterator[sa.Engine]:
    engine = engine_for(url)
    yield engine
    engine.dispose()


@contextmanager
def holder(url: str) -> Iterator[subprocess.Popen[str]]:
    """Run a process that holds the name until it is ended."""
    command = [sys.executable, "-c", HOLDER, url, str(LEASE_S)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process:
        try:
            assert process.stdout.readline() == "taken\n"
            yield process
        finally:
            process.kill()


def names_held(engine: sa.Engine, lease_s: float = 0.0) -> set[str]:
    """Return those of the names ``name`` and ``dead`` that are held."""
    with engine.connect() as connection:
        return held_names(connection, ["name", "dead"], lease_s)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_lock_of_an_ended_or_suspended_process_is_taken(
    url: str, engine: sa.Engine, number: signal.Signals
) -> None:
    with holder(url) as process, closing(SessionLock(url, "name", LEASE_S)) as other:
        assert not other.wait(0.0) and not other.held
        process.send_signal(number)
        assert other.wait(TIMEOUT_S) and other.held
        assert names_held(engine) == {"name"}
        if number == signal.SIGSTOP:
            process.send_signal(signal.SIGCONT)
            assert process.communicate("\n")[0] == "False\n"
    assert names_held(engine) == set()


def test_locks_lost_by_a_restart_are_taken_again_and_count_meanwhile(
    url: str, engine: sa.Engine, postgres: Postgres
) -> None:
    taken, lost = threading.Semaphore(0), threading.Event()
    with closing(SessionLock(url, "name", 30.0, on_taken=taken.release, on_lost=lost.set)) as lock:
        assert taken.acquire(timeout=TIMEOUT_S)
        postgres.kill()
        assert lost.wait(TIMEOUT_S) and not lock.held
        postgres.start()
        engine.dispose()
        assert names_held(engine, 30.0) == {"name", "dead"}
        assert taken.acquire(timeout=TIMEOUT_S)
        assert names_held(engine) == {"name"}
