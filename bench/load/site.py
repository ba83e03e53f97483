"""Site: a whole service under test, with a disk and a clock of its own."""

from __future__ import annotations

import secrets
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import httpx
import psutil

from bench.load.clocks import Clock
from bench.load.disks import Disk
from bench.load.loopback import checked
from foldback.server.settings import MIB_BYTES
from tests.server.service_process import Service

MARK: Final = "FOLDBACK_LOAD_SITE"
"""Environment variable by which the processes of a site are recognised."""
SITE_TIMEOUT_S: Final = 180.0
"""Maximum time that the service under test may take to become ready, and its processes to end, in
s; beyond it the test fails."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """Layout of a service.

    Attributes:
        name: Name in the output.
        settings: Settings of all its processes, without ``FOLDBACK_``; among them a database or a
            storage elsewhere.
        environment: Further environment variables of all its processes.
        supervised: Number of workers that ``serve`` supervises; they end when it does.
        hosts: Number of workers that are started separately, and restarted after they have ended.
        apart: True if those workers have data directories of their own, as on other machines.
        outages: Context managers, by name, during which a shared service does not answer.
    """

    name: str = "one machine"
    settings: Mapping[str, object] = field(default_factory=dict)
    environment: Mapping[str, str] = field(default_factory=dict)
    supervised: int = 1
    hosts: int = 1
    apart: bool = False
    outages: Mapping[str, Callable[[], AbstractContextManager[None]]] = field(default_factory=dict)


ONE_MACHINE: Final = Setup()


class NotReadyError(RuntimeError):
    """Error raised if the service does not become ready in time."""


class Site:
    """Service that can be started, disrupted and restarted; closing it deletes all of its data."""

    def __init__(self, place: Path, setup: Setup) -> None:
        self.place = place
        self.setup = setup
        place.mkdir(parents=True, exist_ok=True)
        self.disk = Disk(place)
        self.clock = Clock(place)
        self._mark = secrets.token_hex(8)
        self._settings: dict[str, object] = {
            "lease_s": 2,
            "min_free_disk_bytes": 4 * MIB_BYTES,
            "largest_queue": 1000,
            "largest_queue_of_visitor": 1000,
            **setup.settings,
        }
        self.web = self._service("web", workers=setup.supervised)
        self._hosts: list[subprocess.Popen[bytes] | None] = [None] * setup.hosts

    @property
    def data_dir(self) -> Path:
        """Data directory of the web process."""
        return self.web.data_dir

    @property
    def address(self) -> str:
        """Address of the web process; empty while it does not listen."""
        return str(self.web.http.base_url)

    def _service(self, name: str, **settings: object) -> Service:
        service = Service(self.disk.path / name, **{"prewarm": True, **self._settings, **settings})
        service.log = self.place / f"{name}.log"
        service.environment.update(
            {**self.clock.environment, **self.setup.environment, MARK: self._mark}
        )
        return service

    def up(self) -> None:
        """Start all processes that are not running, and wait until the service accepts folds.

        Raises:
            NotReadyError: If it does not accept folds in time.
        """
        if self.web.process is None or self.web.process.poll() is not None:
            self.web.start()
            checked(self.address)
        for k, host in enumerate(self._hosts):
            if host is None or host.poll() is not None:
                self._hosts[k] = self._start_host(k)
        deadline = time.monotonic() + SITE_TIMEOUT_S
        while True:
            with suppress(httpx.TransportError):
                answer = self.web.http.get("/ready")
                if answer.status_code == 200:
                    return
                if time.monotonic() > deadline:
                    raise NotReadyError(f"{answer.text}; see {self.place}")
            if time.monotonic() > deadline:
                raise NotReadyError(f"it does not answer; see {self.place}")
            time.sleep(0.05)

    def _start_host(self, k: int) -> subprocess.Popen[bytes]:
        service = self._service(f"host-{k}" if self.setup.apart else "web")
        service.log = self.place / f"host-{k}.log"
        return service.start_worker()

    def processes(self, *kinds: str) -> list[psutil.Process]:
        """Return its processes, of all or some kinds: web, worker, stages, reader, preparer."""
        own_process: list[psutil.Process] = []
        for process in psutil.process_iter():
            with suppress(psutil.Error):
                if process.status() == psutil.STATUS_ZOMBIE:
                    continue
                if process.environ().get(MARK) != self._mark:
                    continue
                if not kinds or _kind(process.cmdline()) in kinds:
                    own_process.append(process)
        return own_process

    def kill_web(self) -> None:
        """Kill the web process only; its children must detect this and end."""
        assert self.web.process is not None
        self.web.process.kill()
        self.web.process.wait()
        self.web.http.close()

    def kill_everything(self) -> None:
        """Kill all processes at once, as a power cut would."""
        processes = self.processes()
        for process in processes:
            with suppress(psutil.Error):
                process.send_signal(signal.SIGKILL)
        for popen in (self.web.process, *self._hosts):
            if popen is not None:
                popen.wait()
        self.web.http.close()
        deadline = time.monotonic() + SITE_TIMEOUT_S
        while self.processes():
            assert time.monotonic() < deadline, "a killed process is still there"
            time.sleep(0.02)

    @contextmanager
    def paused(self) -> Generator[None]:
        """Pause all processes, none of them inside a system call, while the context lasts."""
        while running := [process for process in self.processes() if not _is_paused(process.pid)]:
            for process in running:
                with suppress(psutil.Error):
                    process.suspend()
            time.sleep(0.01)
        try:
            yield
        finally:
            for process in self.processes():
                with suppress(psutil.Error):
                    process.resume()

    def end(self) -> None:
        """Stop all processes gracefully."""
        for host in self._hosts:
            if host is not None and host.poll() is None:
                host.terminate()
        if self.web.process is not None and self.web.process.poll() is None:
            code = self.web.stop()
            assert code == 0, f"the server ended with exit code {code}"
        for host in self._hosts:
            if host is not None:
                host.wait(SITE_TIMEOUT_S)

    def close(self) -> None:
        """Kill all processes and delete the disk."""
        for process in self.processes("worker"):
            with suppress(psutil.Error):
                process.send_signal(signal.SIGCONT)
        self.kill_everything()
        self.disk.close()
        shutil.rmtree(self.disk.path, ignore_errors=True)

    def left_uploads(self) -> list[str]:
        """Return the names of the files in the directory of uploads."""
        folder = self.data_dir / "uploads"
        return sorted(
            path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()
        )

    def answer(self, method: str, path: str, **request_options: Any) -> httpx.Response | None:
        """Send a request; return the answer, or None if the service does not answer."""
        with suppress(httpx.TransportError, RuntimeError):
            return self.web.http.request(method, path, **request_options)
        return None


def _is_paused(pid: int) -> bool:
    """Return True if all threads of a process are paused."""
    try:
        states = [
            (task / "stat").read_text().rpartition(")")[2].split()[0]
            for task in Path(f"/proc/{pid}/task").iterdir()
        ]
    except OSError:  # it, or one of its threads, ends
        return False
    return all(state in "TZX" for state in states)


def _kind(command: list[str]) -> str:
    if "foldback.server.jobs.worker_process" in command or command[-1:] == ["worker"]:
        return "worker"
    if command and command[0].startswith("foldback "):
        return command[0].removeprefix("foldback ")
    return "web" if "serve" in command else ""
