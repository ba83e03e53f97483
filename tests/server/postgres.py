"""PostgreSQL for tests: a cluster of its own in a temporary directory, on a free port."""

import os
import pwd
import shutil
import signal
import socket
import subprocess
import tempfile
import uuid
from pathlib import Path
from typing import Any

import psycopg
import pytest

from foldback.server.store.schema import engine_for, migrate
from tests.server.service_process import wait_until
from tests.tools import POSTGRES

TIMEOUT_S = 60.0
USER = "foldback"
DATABASES = ["sqlite", pytest.param("postgresql", marks=pytest.mark.processes)]
"""Kinds of databases, for tests of both."""


class Postgres:
    """Cluster that can be started, killed and restarted; ``database`` creates a database in it.

    PostgreSQL refuses to run as root, and then runs as another user of this machine. Nothing is
    synced to disk, so that data may be lost in a crash.

    Args:
        user: Name of its superuser.
    """

    def __init__(self, user: str = USER) -> None:
        self._user = user
        self._programs = Path(POSTGRES.get())
        self._user_options = _other_user()
        # pytest's own temporary directory is closed to other users
        self._directory = Path(tempfile.mkdtemp(prefix="foldback-postgres-"))
        self.log = self._directory / "log"
        if self._user_options:
            os.chown(self._directory, self._user_options["user"], self._user_options["group"])
        self._process: subprocess.Popen[bytes] | None = None
        self.port = 0
        self._template = ""
        self._run(
            "initdb",
            *("--pgdata", str(self._cluster), "--username", user, "--auth", "trust"),
            *("--encoding", "UTF8", "--locale", "C", "--no-sync", "--no-instructions"),
        )

    @property
    def _cluster(self) -> Path:
        return self._directory / "cluster"

    @property
    def pid(self) -> int:
        """Id of its first process, the parent of all others."""
        assert self._process is not None
        return self._process.pid

    def start(self) -> "Postgres":
        """Start the cluster, on its earlier port if it had one."""
        self.port = self.port or free_port()
        with open(self.log, "ab") as log:
            self._process = subprocess.Popen(
                [
                    str(self._programs / "postgres"),
                    *("-D", str(self._cluster), "-p", str(self.port)),
                    *("-c", "listen_addresses=127.0.0.1", "-c", "unix_socket_directories="),
                    *("-c", "fsync=off", "-c", "max_connections=300"),
                ],
                cwd=self._directory,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                **self._user_options,
            )
        wait_until(self._answers, self.log.read_text, (psycopg.OperationalError,))
        return self

    def _answers(self) -> bool:
        assert self._process.poll() is None, self.log.read_text()
        psycopg.connect(self.url("postgres")).close()
        return True

    def url(self, database: str) -> str:
        """Return the URL of a database."""
        return f"postgresql://{self._user}@127.0.0.1:{self.port}/{database}"

    def database(self, template: str = "template1") -> str:
        """Create a database, which is empty without a template, and return its URL."""
        name = f"test_{uuid.uuid4().hex[:12]}"
        with psycopg.connect(self.url("postgres"), autocommit=True) as connection:
            connection.execute(f'CREATE DATABASE "{name}" TEMPLATE "{template}"'.encode())
        return self.url(name)

    def owned(self) -> str:
        """Create an empty database whose owner is no superuser; return its URL for the owner."""
        url = self.database()
        name = url.rpartition("/")[2]
        with psycopg.connect(self.url("postgres"), autocommit=True) as connection:
            connection.execute(f'CREATE ROLE "{name}" LOGIN'.encode())
            connection.execute(f'ALTER DATABASE "{name}" OWNER TO "{name}"'.encode())
        return url.replace(f"{self._user}@", f"{name}@")

    def migrated(self) -> str:
        """Create a database with the service's tables and return its URL."""
        if not self._template:
            url = self.database()
            engine = engine_for(url)
            migrate(engine)
            engine.dispose()
            self._template = url.rpartition("/")[2]
        return self.database(self._template)

    def stop(self) -> None:
        """Shut down in order, and close open connections."""
        self._shut_down(signal.SIGINT)

    def kill(self) -> None:
        """Shut down immediately, as after a crash."""
        self._shut_down(signal.SIGQUIT)

    def close(self) -> None:
        """Shut down and remove all files."""
        self.stop()
        shutil.rmtree(self._directory, ignore_errors=True)

    def _shut_down(self, number: int) -> None:
        if self._process is not None and self._process.poll() is None:
            self._process.send_signal(number)
            self._process.wait(TIMEOUT_S)
        self._process = None

    def _run(self, program: str, *arguments: str) -> None:
        done = subprocess.run(
            [str(self._programs / program), *arguments],
            cwd=self._directory,
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
            **self._user_options,
        )
        assert done.returncode == 0, done.stderr


def _other_user() -> dict[str, Any]:
    """Return the arguments to run as another user if this is root; otherwise nothing."""
    if os.geteuid() != 0:
        return {}
    names = {entry.pw_name: entry for entry in pwd.getpwall()}
    postgres = names.get("postgres") or names["nobody"]
    return {"user": postgres.pw_uid, "group": postgres.pw_gid, "extra_groups": []}


def free_port() -> int:
    """Return a port that no program listens on."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        return free.getsockname()[1]
