"""Running a service: it ends with a signal, replaces hung workers, and lives with few files."""

import os
import re
import signal
import socket
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path

import httpx
import psutil
import pytest

from foldback.server.ops.supervisor import SupervisedWorker, environment_of_worker
from foldback.server.settings import Settings
from tests.server.service_process import STAIRS, Service, wait_until

LEASE_S = 1.0


def running(processes: list[psutil.Process]) -> list[psutil.Process]:
    return [p for p in processes if p.is_running() and p.status() != psutil.STATUS_ZOMBIE]


def catches_stop_signals(pid: int) -> bool:
    """Return whether foldback's own code has begun, which catches SIGTERM first of all.

    Before, SIGINT may be lost: while the interpreter starts, Python drops a KeyboardInterrupt that
    is raised in a callback.
    """
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    (caught,) = re.findall(r"^SigCgt:\s*([0-9a-f]+)$", status, re.MULTILINE)
    return bool(int(caught, 16) >> (signal.SIGTERM - 1) & 1)


MOMENTS: dict[str, Callable[[Service], object]] = {
    "first": lambda service: catches_stop_signals(service.process.pid),
    "worker": lambda service: service.processes("foldback.server.jobs.worker_process"),
    "database": lambda service: (service.data_dir / "foldback.db").exists(),
}
"""Moments of the start; `make load ARGS="--only starts"` tries one each 100 ms."""


@pytest.mark.slow
@pytest.mark.processes
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("moment", list(MOMENTS))
def test_stop_signal_during_the_start_ends_all_processes(
    tmp_path: Path, moment: str, number: signal.Signals
) -> None:
    # What started the tests may ignore Ctrl-C, and Python inherits that until it runs.
    service = Service(tmp_path / "data", wrapper=("env", "--default-signal"), prewarm=True)
    process = service.launch()
    wait_until(lambda: MOMENTS[moment](service))
    started = psutil.Process(process.pid).children(recursive=True)
    process.send_signal(number)
    process.communicate(timeout=60)
    wait_until(lambda: not running(started), lambda: running(started))


@pytest.mark.slow
@pytest.mark.processes
def test_stop_signal_ends_a_starting_worker(tmp_path: Path) -> None:
    service = Service(tmp_path / "data")
    with service.worker() as worker:
        wait_until(lambda: (service.data_dir / "foldback.db").exists())
        worker.send_signal(signal.SIGINT)
        worker.wait(60)


@pytest.mark.long
@pytest.mark.processes
def test_stopped_worker_is_replaced_and_its_fold_continues(tmp_path: Path) -> None:
    with Service(tmp_path / "data", lease_s=LEASE_S).start() as service:
        service.wait_workers(1)
        (worker,) = service.processes("foldback.server.jobs.worker_process")
        worker.suspend()
        fold_id = service.fold(STAIRS)["id"]
        assert service.wait_over(fold_id)["status"] == "verified"
        assert not worker.is_running()
        assert "has sent no pulse" in service.log.read_text()


@pytest.mark.processes
def test_worker_is_killed_for_its_own_silence_only(tmp_path: Path) -> None:
    """Time in which the supervisor did not run either, as in a suspended machine, has no effect."""
    settings = Settings(data_dir=tmp_path, prewarm=False)
    now = 0.0
    worker = SupervisedWorker(LEASE_S, clock=lambda: now)
    environment = {**os.environ, **environment_of_worker(settings)}
    worker.look(environment)
    process = worker.process
    assert process is not None
    try:
        for _ in range(3):
            now += 3600.0
            worker.look(environment)
        assert process.poll() is None
        psutil.Process(process.pid).suspend()
        for _ in range(8):
            now += 1.0
            worker.look(environment)
        assert process.wait(60) == -signal.SIGKILL
    finally:
        worker.stop(0.0)  # it may have been started again


@pytest.mark.slow
@pytest.mark.processes
def test_health_is_answered_with_few_open_files(tmp_path: Path) -> None:
    limit_command = ("prlimit", "--nofile=256:256")
    data, proxy = tmp_path / "data", "192.0.2.1"
    service = Service(data, wrapper=limit_command, workers=0, trusted_proxies=proxy).start()
    host, port = service.http.base_url.host, service.http.base_url.port
    assert port is not None
    with service, ExitStack() as stack:
        for k in range(280):
            client = socket.create_connection((host, port), source_address=(f"127.0.1.{k % 8}", 0))
            stack.enter_context(client)
            with suppress(ConnectionError):  # beyond the limit
                client.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-a")
        for path in ("/health", "/gallery"):
            transport = httpx.HTTPTransport(local_address="127.0.9.9")
            with httpx.Client(base_url=service.http.base_url, transport=transport) as other_client:
                assert other_client.get(path, timeout=60).status_code == 200
    log = service.log.read_text()
    assert "connections instead of 2000" in log and "Traceback" not in log
