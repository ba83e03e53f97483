"""Fork server process: loads the children's libraries and kernels, and forks the children.

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
import subprocess
import sys
import threading
import traceback
from collections import deque
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any, Final, NoReturn

from foldback.planner.compilation.compiling import Compiling, beside
from foldback.planner.compilation.compiling_lock import compiling_fraction
from foldback.planner.progress import Progress, silent
from foldback.server.errors import UNEXPECTED_WORDS
from foldback.server.processes.child import Task, serve, task_of
from foldback.server.processes.sandbox import end_threads

MAX_REQUEST_BYTES: Final = 65536
"""Number of bytes that the fork server, which starts computing processes, reads at most at once
from its control socket. A request must fit into it, so a smaller value could lose requests."""
PREPARER: Final = "preparer"
"""Kind of the children that prepare previews."""


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

    def progress(self, progress: Progress) -> None:
        """Send the progress of the start."""
        self.answer(progress=asdict(progress))

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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Late:
    """Kind of children whose kernels another process is still compiling.

    Attributes:
        kind: The kind.
        compiling: The process that compiles the kernels.
        load: Loads the task with the compiled kernels.
    """

    kind: str
    compiling: subprocess.Popen[bytes]
    load: Callable[[], Task]


class _Forks:
    """Forked children."""

    def __init__(self, requests: _Requests, tasks: dict[str, Task], late: _Late | None) -> None:
        self._requests = requests
        self._tasks = tasks
        self._late = late
        self._waiting: list[Callable[[], None]] = []
        self._woken, self._wakes = os.pipe()
        for end in (self._woken, self._wakes):
            os.set_blocking(end, False)
        signal.signal(signal.SIGCHLD, _wake)
        signal.set_wakeup_fd(self._wakes)
        self._running: set[int] = set()

    def serve(self, control: socket.socket) -> None:
        """Answer requests until the parent has ended."""
        self._load_late()
        while True:
            ready, _, _ = select.select([control, self._woken], [], [])
            if self._woken in ready:
                with suppress(BlockingIOError):
                    os.read(self._woken, MAX_REQUEST_BYTES)
                self._reap()
                self._load_late()
            if control in ready:
                for request in self._requests.receive():
                    self._do(request)

    def _do(self, request: dict[str, Any]) -> None:
        match request:
            case {"fork": number, "kind": kind, "limits": limits}:
                fork = partial(self._fork, number, kind, limits, self._requests.pipes())
                if self._late is not None and self._late.kind == kind:
                    self._waiting.append(fork)
                else:
                    fork()
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
        serve(kind, limits, lambda _: self._tasks[kind])

    def _reap(self) -> None:
        while self._running:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if not pid:
                return
            if pid in self._running:  # otherwise it is a compiling process
                self._running.discard(pid)
                self._requests.answer(ended=pid, code=os.waitstatus_to_exitcode(status))

    def _load_late(self) -> None:
        """Load the kernels once the compiling process has ended, and fork waiting children."""
        if self._late is None or self._late.compiling.poll() is None:
            return
        self._tasks[self._late.kind] = self._late.load()
        self._late = None
        _compact_before_fork()
        for fork in self._waiting:
            fork()


@contextmanager
def _ending_with(parent: socket.socket) -> Generator[None]:
    """End this process if the parent closes the connection within the context.

    A thread watches the connection, because compiler and imports occupy the main thread for a
    minute. The thread ends with the context, before any fork.
    """
    stopped, stop = os.pipe()

    def watch() -> None:
        hung_up = select.poll()
        for file in (parent.fileno(), stopped):
            hung_up.register(file, 0)
        if any(file == parent.fileno() for file, _ in hung_up.poll()):
            os._exit(1)

    watching = threading.Thread(target=watch, name="parent", daemon=True)
    watching.start()
    try:
        yield
    finally:
        os.close(stop)
        watching.join()
        os.close(stopped)


def _tasks(
    kinds: Sequence[str], requests: _Requests, *, warm: bool, directory: Path | None
) -> tuple[dict[str, Task], _Late | None]:
    """Return the task of each kind; if ``warm``, with compiled and loaded kernels.

    If the first kind has to compile kernels, other processes compile those of the other kinds, so
    that the start does not wait for them. Children that prepare previews wait, because a confined
    process could not store the kernels that it compiles; others load them from the cache.
    """
    tasks = dict[str, Task]()
    with Compiling() as compiling:
        for kind in kinds:
            tasks[kind] = task_of(
                kind,
                warm=warm and not compiling.has_reported,
                progress=requests.progress,
                directory=directory,
            )
    late = None
    if warm and len(tasks) > 1 and compiling.has_reported:
        if PREPARER in tasks:
            load = partial(_load_preparer, directory)
            late = _Late(kind=PREPARER, compiling=beside("paths", directory), load=load)
        else:
            beside("all", directory)
    if "stages" in tasks and not warm:  # otherwise each fold would load its kernels for 1.5 s
        from foldback.planner.pipeline.warm_up import warm_up_folding

        warm_up_folding(requests.progress, directory=directory)
    return tasks, late


def _load_preparer(directory: Path | None) -> Task:
    """Return the task that prepares previews; compile all kernels unless a worker does."""
    if directory is None or compiling_fraction(directory) is None:
        beside("all", directory)
    return task_of(PREPARER, warm=True, progress=silent, directory=directory)


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
    configuration = json.loads(sys.argv[2])
    requests = _Requests(control)
    try:
        with _ending_with(control):
            directory = configuration["directory"] and Path(configuration["directory"])
            tasks, late = _tasks(
                configuration["kinds"], requests, warm=configuration["warm"], directory=directory
            )
        _compact_before_fork()
    except Exception:
        traceback.print_exc()
        requests.refuse(UNEXPECTED_WORDS)
    requests.answer(ready=True)
    _Forks(requests, tasks, late).serve(control)


if __name__ == "__main__":
    main()
