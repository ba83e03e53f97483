"""A real service in a thread of the tests' own process, for what no process of its own proves."""

from __future__ import annotations

import socket
import threading
from typing import Any

import httpx
import psutil
import uvicorn

from server.commands.serve import server_of
from server.settings import PREFIX, Settings
from tests.server.service import PATIENCE_S, Service

NOWHERE = "NO_TEST_SETS_THIS_"
"""Names of settings in the environment begin so for it: those of the machine count for nothing."""


class ServiceHere(Service):
    """What ``foldback serve --workers 0`` runs, on a port of its own: it starts in no time.

    It has neither a process that could be killed nor a log, and starts no worker.
    """

    def start(self, *arguments: str) -> ServiceHere:
        assert arguments[:1] in ((), ("--first-shape",)), "others are for a process: take a Service"
        given = {
            name.removeprefix(PREFIX).lower(): value
            for name, value in self.environment.items()
            if name.startswith(PREFIX)
        }
        self.settings = Settings(_env_prefix=NOWHERE, **{**given, "workers": 0})  # type: ignore[arg-type]
        self.settings.make_directories()
        self._server = server_of(self.settings, *arguments[1:])
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
        return int(self._thread.is_alive())

    def processes(self, module: str) -> list[psutil.Process]:
        """Those that its fork server has forked, by what they call themselves."""
        app: Any = self._server.config.app
        forks = app.state.context.fork_server
        return [c for c in psutil.Process(forks.pid).children() if module in c.cmdline()]
