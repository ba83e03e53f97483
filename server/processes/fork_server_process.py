"""Fork server process: loads the children's libraries, and forks the children.

It reads no data of visitors. It has only one thread, because a fork does not copy other threads.
Each child applies its own limits and sandbox after the fork.
"""

from __future__ import annotations

import gc
import json
import os
import select
import signal
import socket
import sys
import traceback
from collections import deque
from contextlib import suppress
from types import FrameType
from typing import Any, Final, NoReturn

from foldback.server.errors import UNEXPECTED_WORDS
from foldback.server.processes.child import Task, serve, task_of
from foldback.server.processes.sandbox import end_threads

MAX_REQUEST_BYTES: Final = 65536
"""Number of bytes that the fork server, which starts computing processes, reads at most at once
from its control socket. A request must fit into it, so a smaller value could lose requests."""


class _Requests:
    """Connection to the parent: requests, pipes of the children, and responses."""

    def __init__(self, control: socket.socket) -> None:
        self._control = control
        self._partial_line = b""
        self._pipes: deque[int] = deque()

    def receive(self) -> list[dict[str, Any]]:
        """Return the next requests; end the process once the connection is closed."""
        data, pipes, _, _ = socket.recv_fds(self._control, MAX_REQUEST_BYTES, 64)
        self._pipes.extend(pipes)
        if not data:
            os._exit(0)
        *lines, self._partial_line = (self._partial_line + data).split(b"\n")
        return [json.loads(line) for line in lines]

    def pipes(self) -> tuple[int, int]:
        """Return the input and the output pipe of the next child."""
        return self._pipes.popleft(), self._pipes.popleft()

    def answer(self, **values: object) -> None:
        """Send a response; end the process if the parent has ended."""
        try:
            self._control.sendall(json.dumps(values).encode() + b"\n")
        except (BrokenPipeError, ConnectionResetError):
            os._exit(1)

    def refuse(self, reason: str) -> NoReturn:
        """Answer all requests, forever, with the reason why no child can be forked."""
        self.answer(failed=reason)
        problem = {"event": "problem", "code": "no-start", "detail": reason}
        while True:
            for request in self.receive():
                if "fork" not in request:
                    continue
                stdin, stdout = self.pipes()
                with suppress(BrokenPipeError):
                    os.write(stdout, json.dumps(problem).encode() + b"\n")
                os.close(stdin)
                os.close(stdout)

    def close(self) -> None:
        """Close socket and pipes in a child."""
        self._control.close()
        while self._pipes:
            os.close(self._pipes.popleft())


def _wake(number: int, frame: FrameType | None) -> None:
    """Do nothing. The wake-up pipe gets a byte only if ``SIGCHLD`` has a Python handler."""


class _Forks:
    """Forked children."""

    def __init__(self, requests: _Requests, tasks: dict[str, Task]) -> None:
        self._requests = requests
        self._tasks = tasks
        self._woken, self._wakes = os.pipe()
        for end in (self._woken, self._wakes):
            os.set_blocking(end, False)
        signal.signal(signal.SIGCHLD, _wake)
        signal.set_wakeup_fd(self._wakes)
        self._running: set[int] = set()

    def serve(self, control: socket.socket) -> None:
        """Answer requests until the parent has ended."""
        while True:
            ready, _, _ = select.select([control, self._woken], [], [])
            if self._woken in ready:
                with suppress(BlockingIOError):
                    os.read(self._woken, MAX_REQUEST_BYTES)
                self._reap()
            if control in ready:
                for request in self._requests.receive():
                    self._do(request)

    def _do(self, request: dict[str, Any]) -> None:
        match request:
            case {"fork": number, "kind": kind, "limits": limits}:
                self._fork(number, kind, limits, self._requests.pipes())
            case {"ping": number}:
                self._requests.answer(pong=number)
            case {"kill": pid}:
                if pid in self._running:
                    # Until the child has created its own process group, it is in this one.
                    is_leader = os.getpgid(pid) == pid
                    (os.killpg if is_leader else os.kill)(pid, signal.SIGKILL)
            case _:
                raise ValueError(f"got {request!r}, expected a request to fork, to ping or to kill")

    def _fork(self, number: int, kind: str, limits: dict[str, Any], pipes: tuple[int, int]) -> None:
        stdin, stdout = pipes
        pid = os.fork()
        if not pid:
            try:
                self._become(kind, limits, stdin, stdout)
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(1)
        self._running.add(pid)
        self._requests.answer(forked=number, pid=pid)
        os.close(stdin)
        os.close(stdout)

    def _become(self, kind: str, limits: dict[str, Any], stdin: int, stdout: int) -> None:
        """Continue as a child."""
        os.setsid()
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        os.dup2(stdin, 0)
        os.dup2(stdout, 1)
        for file in (stdin, stdout, self._woken, self._wakes):
            os.close(file)
        self._requests.close()
        serve(kind, limits, lambda: self._tasks[kind])

    def _reap(self) -> None:
        while self._running:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if not pid:
                return
            self._running.discard(pid)
            self._requests.answer(ended=pid, code=os.waitstatus_to_exitcode(status))


def _compact_before_fork() -> None:
    """End the threads of libraries, and let children share all existing objects.

    Otherwise the garbage collector of a child would copy their memory pages by traversing them.
    """
    end_threads()
    gc.collect()
    gc.freeze()


def main() -> None:
    """Load the tasks, and serve requests until the parent has ended."""
    control = socket.socket(fileno=int(sys.argv[1]))
    requests = _Requests(control)
    try:
        tasks = {kind: task_of(kind) for kind in json.loads(sys.argv[2])}
        _compact_before_fork()
    except Exception:
        traceback.print_exc()
        requests.refuse(UNEXPECTED_WORDS)
    requests.answer(ready=True)
    _Forks(requests, tasks).serve(control)


if __name__ == "__main__":
    main()
