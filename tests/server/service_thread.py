"""A real service for tests, in a thread of their own process, where it starts faster."""

from __future__ import annotations

import atexit
import faulthandler
import logging
import shutil
import socket
import sqlite3
import threading
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import psutil
import uvicorn

from server.cli.serve import server_of
from server.ops.logs import TextLines
from server.processes.fork_server import ForkServer
from server.settings import VARIABLE_PREFIX, Settings
from server.store.folds import Store
from tests.server.service_process import PATIENCE_S, Service

NOWHERE = "NO_TEST_SETS_THIS_"
"""Names of settings in the environment begin so for it: those of the machine count for nothing."""
TELLER = logging.getLogger("foldback")
FORKS = ForkServer(["reader", "preparer", "retimer", "stages"], warm=False)
"""Forks for all services of this process, and for tests: to load what children need takes long."""
atexit.register(FORKS.close)


TABLES: list[bytes] = []
"""The file of a database without rows, once one was made."""


def give_tables(settings: Settings) -> None:
    """Puts tables into a place without any: to make them in each is a fifth of a start."""
    path = Path(settings.store_url.removeprefix("sqlite:///"))
    if not path.is_absolute() or path.exists():
        return  # this is no file, or it has tables
    path.parent.mkdir(parents=True, exist_ok=True)
    if TABLES:
        path.write_bytes(TABLES[0])
    else:
        Store(settings).close()
        TABLES.append(path.read_bytes())


class ServiceThread(Service):
    """What ``foldback serve --workers 0`` runs, on a port of its own: it starts in no time.

    It has no process that could be killed, and starts no worker. What others in this process have
    to say stands in its log, too.
    """

    def start(self, *arguments: str) -> ServiceThread:
        assert arguments[:1] in ((), ("--first-shape",)), "others are for a process: take a Service"
        given = {
            name.removeprefix(VARIABLE_PREFIX).lower(): value
            for name, value in self.environment.items()
            if name.startswith(VARIABLE_PREFIX)
        }
        self.settings = Settings(_env_prefix=NOWHERE, **{**given, "workers": 0})  # type: ignore[arg-type]
        self.settings.make_directories()
        give_tables(self.settings)
        self._telling = logging.FileHandler(self.log)
        self._telling.setFormatter(TextLines({}))
        TELLER.addHandler(self._telling)
        TELLER.setLevel(logging.INFO)
        self._server = server_of(self.settings, *arguments[1:], fork_server=FORKS)
        # Whoever connects before it answers waits until it does.
        self._socket = socket.create_server((self.settings.host, 0))
        self._thread = threading.Thread(target=self._serve, args=(self._server, self._socket))
        self._thread.start()
        address = f"http://{self.settings.host}:{self._socket.getsockname()[1]}"
        self.http.close()
        self.http = httpx.Client(base_url=address, timeout=60.0)
        assert httpx.get(f"{address}/health", timeout=PATIENCE_S).status_code == 200
        return self

    @staticmethod
    def _serve(server: uvicorn.Server, listening: socket.socket) -> None:
        with listening:
            server.run(sockets=[listening])

    def take_over(self, other: Service, *fold_ids: str) -> None:
        """Begins with the rows of another service, and with the files of some of its folds."""
        self.data_dir.mkdir()
        name = "foldback.db"
        with (
            closing(sqlite3.connect(other.data_dir / name, timeout=PATIENCE_S)) as theirs,
            closing(sqlite3.connect(self.data_dir / name)) as mine,
        ):
            theirs.backup(mine)
        for fold_id in fold_ids:
            shutil.copytree(other.directory(fold_id), self.directory(fold_id))

    @property
    def running(self) -> bool:
        """Whether it has been started and not been stopped."""
        thread: threading.Thread | None = getattr(self, "_thread", None)
        return thread is not None and thread.is_alive()

    def tell_to_end(self) -> None:
        """As SIGTERM does."""
        self._server.should_exit = True

    def stop(self) -> int:
        self.tell_to_end()
        self.http.close()
        self._thread.join(PATIENCE_S)
        if self._thread.is_alive():
            faulthandler.dump_traceback(2)  # to the standard error: what it waits for
        TELLER.removeHandler(self._telling)
        self._telling.close()
        return int(self._thread.is_alive())

    def __enter__(self) -> ServiceThread:
        return self

    def __exit__(self, *_: object) -> None:
        assert self.stop() == 0

    def processes(self, module: str) -> list[psutil.Process]:
        """Those that were forked for it, by what they call themselves."""
        app: Any = self._server.config.app
        context = app.state.context
        pools = (
            context.reader._pool,
            context.preview_reports._reader._pool,
            context.trajectories._pool,
        )
        mine = {child.pid for pool in pools for child in pool._children._all}
        forked = psutil.Process(FORKS.pid).children()
        return [c for c in forked if c.pid in mine and module in c.cmdline()]
