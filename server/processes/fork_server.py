"""Fork server: a process that has loaded the children's libraries; children are its forks.

Loading takes seconds and hundreds of megabytes; a fork takes neither. Requests and responses are
JSON lines on a socket pair; the pipes of a child are sent with its request. The server's side is
``server/processes/fork_server_process.py``.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, BinaryIO, Final, Literal

from foldback.server.processes.limits import ChildLimits, environment_of_child

Kind = Literal["stages", "reader", "preparer", "movies", "retimer", "figures", "pictures"]
CHILD_ENVIRONMENT: Final = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MUJOCO_GL": "off",
    "SPT_NOENV": "1",
}
"""Environment variables of every computing process: one thread for linear algebra (more cost memory
and gain nothing at these matrix sizes), no OpenGL in MuJoCo, as only movies draw with it, and no
process title in the environment's memory."""
PING_INTERVAL_S: Final = 1.0
"""Time without a message from the fork server after which a waiting thread sends it a ping, in
s."""
MAX_SILENCE_S: Final = 30.0
"""Time within which the fork server must answer a ping, in s; otherwise it counts as hung, and
another one replaces it. It answers in milliseconds."""


def environment_with(extra: Mapping[str, str]) -> dict[str, str]:
    """Return the environment of a computing process or fork server, extended by ``extra``."""
    return {**environment_of_child(os.environ), **CHILD_ENVIRONMENT, **extra}


class Forked:
    """Forked child, with the interface of ``Popen`` that ``Child`` uses."""

    def __init__(self, server: _Running, stdin: BinaryIO, stdout: BinaryIO) -> None:
        self.stdin = stdin
        self.stdout = stdout
        self._server = server
        self._pid: int | None = None
        self._code: int | None = None
        self._ended = threading.Event()
        self.lost = False
        """True once this child has ended because the fork server has."""

    @property
    def pid(self) -> int:
        """Process id; the fork server's until the child is forked."""
        return self._server.pid if self._pid is None else self._pid

    @property
    def begun(self) -> bool:
        """True once the process is forked."""
        return self._pid is not None

    @property
    def stalled(self) -> bool:
        """True if the fork server was ready and no longer responds."""
        return self._code is None and self._server.stalled()

    def end_server(self) -> None:
        """End the fork server and all its children; the next child starts another one."""
        self._server.close()

    def poll(self) -> int | None:
        """Return the exit code, negative for a signal; None while it runs."""
        return self._code

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end of the child and return its exit code.

        Raises:
            subprocess.TimeoutExpired: If it does not end in time.
        """
        if not self._ended.wait(timeout):
            raise subprocess.TimeoutExpired("a forked child", timeout or 0.0)
        assert self._code is not None
        return self._code

    def kill_group(self) -> None:
        """Kill the child and its descendants. A child that is not forked yet ends at its start."""
        if self._pid is None:
            self.stdin.close()
            self.end(-signal.SIGKILL)
        elif self._code is None:
            self._server.kill(self._pid)

    def begin(self, pid: int) -> None:
        """Record that the child is forked."""
        self._pid = pid

    def end(self, code: int) -> None:
        """Record that the child has ended."""
        if self._code is None:
            self._code = code
            self._ended.set()

    def lose(self) -> None:
        """Record that the child has ended with the fork server."""
        if self._code is None:
            self.lost = True
        self.end(-signal.SIGKILL)


class _Running:
    """Running process of a fork server."""

    def __init__(self, kinds: Sequence[Kind], environment: Mapping[str, str]) -> None:
        own_end, child_end = socket.socketpair()
        with child_end:
            self._process = subprocess.Popen(
                [
                    *(sys.executable, "-P", "-m", "foldback.server.processes.fork_server_process"),
                    *(str(child_end.fileno()), json.dumps(kinds)),
                ],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                env=environment_with(environment),
                pass_fds=(child_end.fileno(),),
                start_new_session=True,
            )
        self._control = own_end
        self._lock = threading.Lock()
        self._numbers = itertools.count()
        self._asked: dict[int, Forked] = {}
        self._forked: dict[int, Forked] = {}
        self._failed = False
        self.ready = False
        self._heard_at = 0.0
        self._pinged_at: float | None = None
        threading.Thread(target=self._listen, name="fork-server", daemon=True).start()

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """True while the process runs."""
        return not self._failed and self._process.poll() is None

    def fork(self, kind: Kind, limits: ChildLimits) -> Forked | None:
        """Request a child without waiting for it; return None if none can be forked.

        Raises:
            OSError: If there are too many open files.
        """
        with self._lock:
            if not self.alive:
                return None
            theirs_in, mine_in = os.pipe()
            mine_out, theirs_out = os.pipe()
            number = next(self._numbers)
            child = Forked(self, os.fdopen(mine_in, "wb"), os.fdopen(mine_out, "rb"))
            self._asked[number] = child
            request = {"fork": number, "kind": kind, "limits": asdict(limits)}
            line = json.dumps(request).encode() + b"\n"
            # If the server ends now, the end of the child's output reports this.
            with contextlib.suppress(OSError):
                socket.send_fds(self._control, [line], [theirs_in, theirs_out])
            os.close(theirs_in)
            os.close(theirs_out)
            return child

    def kill(self, pid: int) -> None:
        """Kill a child and its descendants.

        The fork server does this, because only it knows that the process id is still the child's.
        """
        with self._lock, contextlib.suppress(OSError):
            self._control.sendall(json.dumps({"kill": pid}).encode() + b"\n")

    def stalled(self) -> bool:
        """Return True if the server was ready and has not answered a ping in ``MAX_SILENCE_S``."""
        with self._lock:
            now = time.monotonic()
            if not self.ready or not self.alive or now < self._heard_at + PING_INTERVAL_S:
                return False
            if self._pinged_at is None:
                self._pinged_at = now
                with contextlib.suppress(OSError):
                    self._control.sendall(b'{"ping": 1}\n')
            return now > self._pinged_at + MAX_SILENCE_S

    def close(self) -> None:
        """End the fork server and its children."""
        self._process.kill()
        self._process.wait()

    def _listen(self) -> None:
        with self._control, contextlib.suppress(ConnectionResetError):
            for line in self._control.makefile("rb"):
                self._hear(json.loads(line))
        self._process.wait()
        with self._lock:
            for pid, child in self._forked.items():
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.killpg(pid, signal.SIGKILL)
                child.lose()
            for child in self._asked.values():
                child.lose()

    def _hear(self, message: dict[str, Any]) -> None:
        with self._lock:
            self._heard_at, self._pinged_at = time.monotonic(), None
            match message:
                case {"ready": _}:
                    self.ready = True
                case {"failed": _}:
                    # Requested children receive the reason; further requests go to a new process.
                    self._failed = True
                    self._control.shutdown(socket.SHUT_WR)
                case {"forked": number, "pid": pid}:
                    self._forked[pid] = child = self._asked.pop(number)
                    child.begin(pid)
                case {"pong": _}:
                    pass
                case {"ended": pid, "code": code}:
                    self._forked.pop(pid).end(code)
                case _:
                    raise ValueError(f"got the unknown message {message!r} from the fork server")


class ForkServer:
    """Fork server that starts with the first child, and again after it has ended.

    Args:
        kinds: Kinds of children that it forks.
        environment: Additional environment variables.
    """

    def __init__(
        self, kinds: Sequence[Kind], *, environment: Mapping[str, str] | None = None
    ) -> None:
        self._kinds = kinds
        self._environment = dict(environment or {})
        self._lock = threading.Lock()
        self._running: _Running | None = None
        self._closed = False

    @property
    def pid(self) -> int | None:
        """Process id; None before the start."""
        return None if self._running is None else self._running.pid

    def start(self) -> None:
        """Start the fork server ahead of the first child."""
        with self._lock:
            self._started()

    def fork(self, kind: Kind, limits: ChildLimits) -> Forked:
        """Request a child and return it, without waiting until it is forked.

        Raises:
            OSError: If there are too many processes or open files, or the server was closed.
        """
        while True:
            with self._lock:
                running = self._started()
            if (child := running.fork(kind, limits)) is not None:
                return child

    def close(self) -> None:
        """End the fork server and its children."""
        with self._lock:
            self._closed = True
            if self._running is not None:
                self._running.close()

    def _started(self) -> _Running:
        if self._closed:
            raise BrokenPipeError("the fork server was closed")
        if self._running is None or not self._running.alive:
            self._running = _Running(self._kinds, self._environment)
        return self._running
