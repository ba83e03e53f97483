"""Dask cluster of separate programs, which may be killed, suspended and cut off."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Final

import psutil

START_PERIOD_S: Final = 0.2
"""Time between two looks at whether a program has ended and is started again, s."""


def free_port() -> int:
    """Return a port that no program uses now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Restarted:
    """Program that is started again when it has ended, as by systemd with ``Restart=always``."""

    def __init__(self, arguments: Sequence[str], log: Path, environment: dict[str, str]) -> None:
        self._arguments = [sys.executable, *arguments]
        self._environment = os.environ | environment
        self._log: IO[bytes] = log.open("ab")
        self._ends = False
        self.starts = 0
        self._start()
        self._thread = threading.Thread(target=self._keep_running, daemon=True)
        self._thread.start()

    def _start(self) -> None:
        self.process = subprocess.Popen(
            self._arguments, env=self._environment, stdout=self._log, stderr=self._log
        )
        self.starts += 1

    def _keep_running(self) -> None:
        while not self._ends:
            if self.process.poll() is not None:
                self._start()
            time.sleep(START_PERIOD_S)

    def worker(self) -> psutil.Process | None:
        """Return the worker of a nanny, which is this program; None if there is none now."""
        with contextlib.suppress(psutil.Error):
            for child in psutil.Process(self.process.pid).children():
                if "resource_tracker" not in " ".join(child.cmdline()):
                    return child
        return None

    def end(self) -> None:
        """End the program for good."""
        self._ends = True
        self._thread.join()
        self.process.kill()
        self.process.wait()
        self._log.close()


class Relay:
    """Relay of TCP connections, which may be cut off as a machine whose cable is pulled."""

    def __init__(self, port: int) -> None:
        self._target = port
        self._connected = threading.Event()
        self._connected.set()
        self._sockets: set[socket.socket] = set()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._listener.getsockname()[1])
        threading.Thread(target=self._accept, daemon=True).start()

    def cut_off(self, seconds: float) -> None:
        """Forward nothing for some time, then break all connections."""
        self._connected.clear()
        time.sleep(seconds)
        for connection in list(self._sockets):
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
        self._connected.set()

    def close(self) -> None:
        """Accept no more connections."""
        self._listener.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                near, _ = self._listener.accept()
                threading.Thread(target=self._forward, args=(near,), daemon=True).start()

    def _forward(self, near: socket.socket) -> None:
        self._connected.wait()
        with near, contextlib.suppress(OSError):
            far = socket.create_connection(("127.0.0.1", self._target), timeout=60)
            far.settimeout(None)
            with far:
                self._sockets |= {near, far}
                other = {near: far, far: near}
                while True:
                    for source in select.select([near, far], [], [])[0]:
                        data = source.recv(65536)
                        self._connected.wait()
                        if not data:
                            return
                        other[source].sendall(data)
