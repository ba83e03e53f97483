"""Tests of the resident process: commands in copies of it do what they do in their own process."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from foldback.server.cli import resident, resident_client
from foldback.server.cli.interrupts import INTERRUPTED

WAIT_S = 60.0
"""Time within which a process must start or end, in seconds."""


def until(value: Callable[[], object]) -> None:
    """Wait until a value is true."""
    end = time.monotonic() + WAIT_S
    while not value():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


@pytest.fixture(scope="module")
def name(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Yield the address of a resident process of these tests alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FOLDBACK_TEST_RUN", str(tmp_path_factory.mktemp("resident")))
        yield resident_client.address()


@pytest.fixture(scope="module")
def running(name: str) -> Iterator[subprocess.Popen[bytes]]:
    """Yield a resident process that accepts commands."""
    with subprocess.Popen([sys.executable, "-m", "foldback.server.cli.resident"]) as process:

        def accepts() -> bool:
            with socket.socket(socket.AF_UNIX) as connection:
                return connection.connect_ex(name) == 0

        until(accepts)
        yield process
        process.terminate()


def command(*arguments: str, option: str = "--resident") -> list[str]:
    """Return a command line of foldback."""
    return [sys.executable, "-m", "foldback.server.cli", option, *arguments]


def children(process: int) -> list[int]:
    """Return the processes that a process has started."""
    return [
        int(word) for word in Path(f"/proc/{process}/task/{process}/children").read_text().split()
    ]


def test_commands_end_as_in_their_own_process(
    running: subprocess.Popen[bytes], tmp_path: Path
) -> None:
    """Output, files, exit status and current directory are those of a process of its own."""
    for arguments in (
        ["shape", "wrench-24", "--out", "path.json"],
        ["shape", "no-such", "--out", "x"],
    ):
        results: list[tuple[int, bytes, bytes, list[bytes]]] = []
        for option in ("--resident", "--no-resident"):
            folder = tmp_path / option
            folder.mkdir(exist_ok=True)
            ended = subprocess.run(
                command(*arguments, option=option), cwd=folder, capture_output=True
            )
            files = [path.read_bytes() for path in sorted(folder.iterdir())]
            results.append((ended.returncode, ended.stdout, ended.stderr, files))
        assert results[0] == results[1]
    assert running.poll() is None


def test_interrupt_reaches_the_command(running: subprocess.Popen[bytes], tmp_path: Path) -> None:
    """Ctrl+C ends a fold in the resident process as it ends one in a process of its own."""
    statuses: list[int] = []
    for option in ("--resident", "--no-resident"):
        out = tmp_path / option
        fold = command("fold", "wrench-160", "--out", str(out), option=option)
        with subprocess.Popen(
            fold, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        ) as process:
            until((out / ".foldback-new").exists)
            assert bool(children(running.pid)) == (option == "--resident")
            process.send_signal(signal.SIGINT)
            statuses.append(process.wait(WAIT_S))
    assert statuses == [INTERRUPTED, INTERRUPTED]
    until(lambda: not children(running.pid))


def test_command_ends_with_its_client(running: subprocess.Popen[bytes], tmp_path: Path) -> None:
    """A command whose client was killed does not go on."""
    fold = command("fold", "wrench-160", "--out", str(tmp_path / "out"))
    with subprocess.Popen(fold, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        until(lambda: children(running.pid))
        process.kill()
    until(lambda: not children(running.pid))
    assert running.poll() is None


def test_damaged_requests_end_nothing(running: subprocess.Popen[bytes], name: str) -> None:
    """Other formats and lengths are refused, and the process goes on."""
    for message in (b"", b"\0", resident_client.HEADER.pack(5) + b"hello", b"\xff" * 64):
        with socket.socket(socket.AF_UNIX) as connection:
            connection.connect(name)
            connection.settimeout(WAIT_S)
            socket.send_fds(connection, [message], [0, 1, 2, 0] if len(message) > 4 else [])
            connection.shutdown(socket.SHUT_WR)
            try:
                assert connection.recv(1) == b""
            except ConnectionResetError:
                continue
    assert running.poll() is None


def test_other_users_are_refused(
    running: subprocess.Popen[bytes], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither end speaks with a process of another user."""
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(name)
        assert resident_client.same_user(connection)
        user = os.getuid()
        monkeypatch.setattr(os, "getuid", lambda: user + 1)
        assert not resident_client.same_user(connection)
        monkeypatch.setattr(resident_client, "address", lambda: name)
        arguments = ["--resident", "shape", "wrench-24", "--out", "never"]
        assert resident_client.run_resident(arguments) == arguments[1:]
    assert not children(running.pid)


def test_it_ends_when_idle_or_out_of_date(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After the idle time, and when an imported file has changed, the process ends."""
    source = tmp_path / "module.py"
    source.write_text("before")
    monkeypatch.setattr(resident, "_imported_files", lambda: [str(source)])
    name = f"\0{tmp_path}"
    for change in (False, True):
        with socket.socket(socket.AF_UNIX) as listener, socket.socket(socket.AF_UNIX) as client:
            listener.bind(name)
            listener.listen()
            server = resident.Server(listener, idle_s=WAIT_S if change else 0.0)
            if change:
                source.write_text("after, and longer")
                client.connect(name)
                resident_client._send(client, ["shape"])  # pyright: ignore[reportPrivateUsage]
            assert server.serve() is None
            assert listener.fileno() == -1 if change else listener.fileno() >= 0


def test_scripts_and_services_run_in_their_own_process(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a terminal, and for commands that start the service, nothing is handed over."""
    assert resident_client.run_resident(["fold", "wrench-24"]) == ["fold", "wrench-24"]
    assert resident_client.run_resident(["--resident", "serve"]) == ["serve"]
    assert resident_client.run_resident(["--no-resident", "fold"]) == ["fold"]
    assert resident_client.run_resident([]) == []
    monkeypatch.setattr(resident_client, "_is_terminal", lambda: True)
    monkeypatch.setattr(sys, "platform", "darwin")
    assert resident_client.run_resident(["fold"]) == ["fold"]
