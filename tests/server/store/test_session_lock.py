"""Locks of sessions: they end with their process, their lease, or PostgreSQL, and come back."""

import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager

import pytest
import sqlalchemy as sa

from foldback.server.settings import Settings
from foldback.server.store.schema import JOBS_CHANNEL, engine_for
from foldback.server.store.session_lock import SessionLock, held_names
from tests.server.postgres import Postgres
from tests.server.service_process import wait_until

pytestmark = pytest.mark.processes
LEASE_S = 1.0
FD_SETSIZE = 1024
"""Number of descriptors that ``select`` can wait for."""
HOLDER = """
import sys, time
from foldback.server.store.session_lock import SessionLock
lock = SessionLock(sys.argv[1], "name", float(sys.argv[2]))
while not lock.held:
    time.sleep(0.01)
print("held", flush=True)
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
            assert process.stdout.readline() == "held\n"
            yield process
        finally:
            process.kill()


@contextmanager
def raised_file_limit() -> Iterator[None]:
    """Permit this process to open as many files as it may."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def held(engine: sa.Engine) -> set[str]:
    """Return those of two names that are held."""
    with engine.connect() as connection:
        return held_names(connection, ["name", "another"])


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_lock_of_an_ended_or_suspended_process_is_taken(
    url: str, engine: sa.Engine, number: signal.Signals
) -> None:
    with holder(url) as process, closing(SessionLock(url, "name", LEASE_S)) as other:
        assert held(engine) == {"name"}
        process.send_signal(number)
        wait_until(lambda: other.settled)
        assert held(engine) == {"name"}
        if number == signal.SIGSTOP:
            process.send_signal(signal.SIGCONT)
            assert process.communicate("\n")[0] == "False\n"
    wait_until(lambda: not held(engine))


def test_lock_of_a_process_with_many_open_files_is_held(url: str, engine: sa.Engine) -> None:
    notices: list[None] = []
    with ExitStack() as opened, raised_file_limit():
        for _ in range(FD_SETSIZE):
            opened.enter_context(open(os.devnull))
        lock = SessionLock(url, "name", LEASE_S, on_notice=lambda: notices.append(None))
        opened.enter_context(closing(lock))
        wait_until(lambda: lock.held)
        with engine.begin() as connection:
            connection.execute(sa.select(sa.func.pg_notify(JOBS_CHANNEL, "")))
        wait_until(lambda: len(notices) == 2)  # the first one is of the lock itself


def test_lock_lost_by_a_restart_of_the_database_is_taken_again(
    url: str, engine: sa.Engine, postgres: Postgres
) -> None:
    """For a while, its holder concludes nothing from missing locks of others."""
    with closing(SessionLock(url, "name", 30.0)) as lock:
        wait_until(lambda: lock.settled)
        postgres.kill()
        wait_until(lambda: not lock.held)
        postgres.start()
        engine.dispose()
        wait_until(lambda: held(engine) == {"name"})
        assert not lock.settled
