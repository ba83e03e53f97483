"""A real service for tests, in a thread of their own process, which starts faster."""

import atexit
import faulthandler
import logging
import shutil
import socket
import sqlite3
import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any, Self

import httpx
import psutil
import uvicorn

from foldback.server import context
from foldback.server.cli.serve import server_of
from foldback.server.jobs import runner
from foldback.server.ops.logs import TextLines
from foldback.server.processes.fork_server import ForkServer
from foldback.server.settings import VARIABLE_PREFIX, Settings
from foldback.server.store.folds import Store
from tests.server.service_process import TIMEOUT_S, Service

UNUSED_PREFIX = "NO_TEST_SETS_THIS_"
"""Prefix that no environment variable has, so that the machine's own settings are ignored."""
LOGGER = logging.getLogger("foldback")


class SharedForks(ForkServer):
    """Fork server for all services of this process, and for tests, since it takes long to load."""

    def close(self) -> None:
        """Do nothing: the fork server ends with the process of the tests."""


FORKS = SharedForks(["reader", "preparer", "retimer", "pictures", "stages"])
atexit.register(ForkServer.close, FORKS)
for module in (context, runner):
    setattr(module, ForkServer.__name__, lambda *_, **__: FORKS)  # pyright: ignore


EMPTY_DATABASE: list[bytes] = []
"""Cached content of a database file without rows; empty until one is made."""


def copy_schema(settings: Settings) -> None:
    """Copy empty tables to a new data directory; creating them takes a fifth of a start."""
    path = Path(settings.store_url.removeprefix("sqlite:///"))
    if not path.is_absolute() or path.exists():
        return  # no file, or it has tables already
    path.parent.mkdir(parents=True, exist_ok=True)
    if EMPTY_DATABASE:
        path.write_bytes(EMPTY_DATABASE[0])
    else:
        Store(settings).close()
        EMPTY_DATABASE.append(path.read_bytes())


class ServiceThread(Service):
    """Service like ``foldback serve --workers 0``, on a port of its own, which starts quickly.

    It has no process that could be killed, and starts no worker. Its log also contains the messages
    of others in this process.
    """

    def start(self, *arguments: str) -> Self:
        assert arguments[:1] in ((), ("--first-shape",)), "others are for a process: take a Service"
        fold_values = {
            name.removeprefix(VARIABLE_PREFIX).lower(): value
            for name, value in self.environment.items()
            if name.startswith(VARIABLE_PREFIX)
        }
        self.settings = Settings(_env_prefix=UNUSED_PREFIX, **{**fold_values, "workers": 0})  # type: ignore[arg-type]
        self.settings.make_directories()
        copy_schema(self.settings)
        self._handler = logging.FileHandler(self.log)
        self._handler.setFormatter(TextLines({}))
        LOGGER.addHandler(self._handler)
        LOGGER.setLevel(logging.INFO)
        self._server = server_of(self.settings, *arguments[1:])
        # Connections before the server is ready wait until it answers.
        self._socket = socket.create_server((self.settings.host, 0))
        self._thread = threading.Thread(target=self._serve, args=(self._server, self._socket))
        self._thread.start()
        address = f"http://{self.settings.host}:{self._socket.getsockname()[1]}"
        self.http.close()
        self.http = httpx.Client(base_url=address, timeout=60.0)
        assert httpx.get(f"{address}/health", timeout=TIMEOUT_S).status_code == 200
        return self

    @staticmethod
    def _serve(server: uvicorn.Server, listening: socket.socket) -> None:
        with listening:
            server.run(sockets=[listening])

    def copy_from(self, other_service: Service, *fold_ids: str) -> None:
        """Start with the rows of another service, and with the files of some of its folds."""
        self.data_dir.mkdir()
        name = "foldback.db"
        with (
            closing(
                sqlite3.connect(other_service.data_dir / name, timeout=TIMEOUT_S)
            ) as their_closing,
            closing(sqlite3.connect(self.data_dir / name)) as own_closing,
        ):
            their_closing.backup(own_closing)
        for fold_id in fold_ids:
            shutil.copytree(other_service.directory(fold_id), self.directory(fold_id))

    @property
    def running(self) -> bool:
        """True from the start to the stop of the service."""
        thread: threading.Thread | None = getattr(self, "_thread", None)
        return thread is not None and thread.is_alive()

    def request_stop(self) -> None:
        """Ask the service to stop, as SIGTERM does."""
        self._server.should_exit = True

    def stop(self) -> int:
        self.request_stop()
        self.http.close()
        self._thread.join(TIMEOUT_S)
        if self._thread.is_alive():
            faulthandler.dump_traceback(2)  # print where the thread hangs
        LOGGER.removeHandler(self._handler)
        self._handler.close()
        return int(self._thread.is_alive())

    def processes(self, module: str) -> list[psutil.Process]:
        """Return its forked processes that have a name."""
        app: Any = self._server.config.app
        context = app.state.context
        pools = (
            context.reader,
            context.preview_reports._reader,
            context.trajectories._pool,
        )
        pids = {child.pid for pool in pools for child in pool._children._all}
        forked = psutil.Process(FORKS.pid).children()
        return [c for c in forked if c.pid in pids and module in c.cmdline()]


ServiceWith = Callable[..., ServiceThread]
"""Type of the fixture ``service_with``."""
