"""Children: computing processes with limits, one for each fold.

Messages are JSON lines: requests on the child's standard input, events on its standard output. When
its standard input ends, its parent has ended, and it ends too. The child's side is
``server/processes/child.py``.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import psutil

from foldback.planner.errors import InputError
from foldback.planner.progress import STAGE_TEXTS
from foldback.server.processes.fork_server import Forked, ForkServer, Kind, environment_with
from foldback.server.processes.limits import ChildLimits, memory_words

if TYPE_CHECKING:
    from foldback.server.limits.concurrency_quota import Quota

CHILD_POLL_S: Final = 0.05
"""Maximum time between two checks of a computing process for its memory limit and for a
cancellation, in s."""
CANCEL_GRACE_S: Final = 0.7
"""Time that a computing process may take to end a cancelled task, in s; then it is killed."""
MAX_START_CPU_S: Final = 60.0
"""Maximum processor time of the start of a computing process, in s; beyond it the process is
killed."""
MAX_START_S: Final = 600.0
"""Maximum wall time of the start of a computing process, in s; beyond it the process is killed."""
KILL_S: Final = 10.0
"""Time within which a killed computing process must end, in s; otherwise its fork server counts as
hung and is ended, too."""
BUSY_FACTOR: Final = 6.0
"""Maximum wall time of a short task, such as a preview, as a multiple of its time limit, if the
machine is too busy to give it that much processor time. With a smaller value shapes are refused
because of the work of others."""
NO_START: Final = "no-start"
"""Error code if no computing process could be started."""
BUSY: Final = "busy"
"""Error code if a task ended at its time limit because the machine was too busy."""
LOST: Final = "lost"
"""Error code if a computing process ended because its parent, the fork server, ended. The task is
not the cause and may be repeated."""
CRASHED: Final = "crashed"
"""Error code if a computing process exited by itself, was ended by a signal, or sent an invalid
message."""
EVENTS: Final = {
    "ready": set[str](),
    "progress": {
        *("stage", "fraction", "steps", "steps_per_second", "simulated_s", "message"),
        *("plan", "plans"),
    },
    "done": {"result"},
    "bad-input": {"code", "detail", "where", "message", "values"},
    "problem": {"code", "detail"},
}
"""Names of the messages that a computing process sends, with the fields that each must have; other
messages are invalid."""


class ChildError(Exception):
    """A child did not return a result.

    Attributes:
        code: Short stable identifier for programs.
        detail: Description and remedy.
        temporary: True if the input is not the cause, and another attempt may succeed.
    """

    def __init__(self, code: str, detail: str) -> None:
        super().__init__(detail)
        self.code = code
        self.detail = detail
        self.temporary = code in (NO_START, BUSY)


class _Spawned(subprocess.Popen[bytes]):
    """Child that is started without a fork server; same interface as ``Forked``."""

    begun: Final = True
    lost: Final = False
    stalled: Final = False

    def __init__(self, kind: Kind, limits: ChildLimits, environment: Mapping[str, str]) -> None:
        super().__init__(
            [
                sys.executable,
                "-P",
                "-m",
                "foldback.server.processes.child",
                kind,
                json.dumps(asdict(limits)),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment_with(environment),
            start_new_session=True,
        )

    def end_server(self) -> None:
        """Do nothing, because this process has no fork server."""

    def kill_group(self) -> None:
        """Kill the child and its descendants."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, signal.SIGKILL)


class Child:
    """Child process.

    Args:
        kind: Kind of its tasks.
        limits: Its resource limits.
        fork_server: Server that forks it; if None, a new interpreter starts, which takes seconds.
        environment: Additional environment variables of a child that is not forked.
    """

    def __init__(
        self,
        kind: Kind,
        limits: ChildLimits,
        *,
        fork_server: ForkServer | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self._limits = limits
        self._events: queue.Queue[bytes | None] = queue.Queue(32)
        self._process: Forked | _Spawned = (
            _Spawned(kind, limits, environment or {})
            if fork_server is None
            else fork_server.fork(kind, limits)
        )
        self._ready = False
        self.calls = 0
        """Number of tasks that it has been given."""
        self._reading = threading.Thread(target=self._read, name="child-events", daemon=True)
        self._reading.start()

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """True while the process runs."""
        return self._process.poll() is None

    def call(
        self,
        task: str,
        directory: Path,
        *,
        wall_s: float,
        epoch: int = 0,
        busy_factor: float = 1.0,
        on_progress: Callable[[dict[str, Any]], None] | None = None,
        cancelled: Callable[[], bool] | None = None,
    ) -> dict[str, Any]:
        """Run one task and wait for its result.

        Args:
            task: Name of the task, such as a stage of the planner.
            directory: Directory of the task's files.
            wall_s: Limit of wall time, s.
            epoch: Epoch of the execution of a fold; 0 for tasks of other kinds.
            busy_factor: Multiple of ``wall_s`` that the task may take as long as it has used less
                processor time than ``wall_s``.
            on_progress: Called with every progress event.
            cancelled: Polled; once it returns True, the child is asked to stop, and killed after
                ``CANCEL_GRACE_S``.

        Raises:
            InputError: If the input is invalid.
            ChildError: If the child crashed or exceeded a limit.
        """
        if not self._wait_ready(cancelled):
            return {"status": "cancelled", "reason": "cancelled"}
        self.calls += 1
        self._send({"task": task, "directory": str(directory), "epoch": epoch})
        started, begun_cpu_s = time.monotonic(), self._cpu_s()
        stop_at: float | None = None
        while True:
            self._check_memory()
            event = self._next(CHILD_POLL_S)
            now = time.monotonic()
            if event is not None:
                match event["event"]:
                    case "progress":
                        if on_progress is not None:
                            on_progress(event)
                    case "done":
                        return event["result"]
                    case "bad-input":
                        fields = ("code", "detail", "where", "message", "values")
                        raise InputError.reported(*(event[name] for name in fields))
                    case _:
                        raise ChildError(event["code"], event["detail"])
            if now > started + wall_s:
                slowed = self._cpu_s() - begun_cpu_s < wall_s and busy_factor > 1.0
                if not slowed or now > started + busy_factor * wall_s:
                    self.kill()
                    raise _too_slow(task, wall_s, slowed=slowed)
            if stop_at is None:
                if cancelled is not None and cancelled():
                    self._send({"cancel": True})
                    stop_at = now + CANCEL_GRACE_S
            elif now > stop_at:
                self.kill()
                return {"status": "cancelled", "reason": "cancelled"}

    def kill(self) -> None:
        """Kill the child."""
        self._process.kill_group()
        try:
            self._process.wait(KILL_S)
        except subprocess.TimeoutExpired:  # the fork server, which kills it, does not respond
            self._process.end_server()
            self._process.wait()

    def close(self) -> None:
        """End the child and close its pipes."""
        self.kill()
        # The reading thread may be waiting for room in the queue. If the child is not forked yet,
        # the thread ends later.
        while self._reading.is_alive() and self._process.begun:
            with contextlib.suppress(queue.Empty):
                self._events.get(timeout=CHILD_POLL_S)
        with contextlib.suppress(queue.Full):  # wakes callers that still wait for an event
            self._events.put_nowait(None)
        if self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.close()

    def _wait_ready(self, cancelled: Callable[[], bool] | None) -> bool:
        """Wait until the child has loaded its libraries; return False if cancelled meanwhile."""
        deadline = time.monotonic() + MAX_START_S
        while not self._ready:
            event = self._next(2 * CHILD_POLL_S)
            if event is not None and event["event"] == "ready":
                self._ready = True
            elif (
                event is not None or time.monotonic() > deadline or self._cpu_s() > MAX_START_CPU_S
            ):
                detail = "it took too long" if event is None else str(event["detail"])
                self.kill()
                raise ChildError(NO_START, f"a computing process did not start: {detail}")
            elif self._process.stalled:
                self._process.end_server()
                detail = "a computing process did not start: it was not created in time"
                raise ChildError(NO_START, detail)
            elif cancelled is not None and cancelled():
                return False
        return True

    def _cpu_s(self) -> float:
        try:
            times = psutil.Process(self._process.pid).cpu_times()
        except psutil.Error:  # the process has ended; reading its events raises the error
            return 0.0
        return times.user + times.system

    def _send(self, message: dict[str, Any]) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(message).encode() + b"\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            pass  # the process has ended; reading its events raises the error

    def _next(self, timeout_s: float) -> dict[str, Any] | None:
        try:
            line = self._events.get(timeout=timeout_s)
        except queue.Empty:
            return None
        if line is None:
            self._events.put(None)
            raise self._death()
        if (event := _event(line)) is None:
            self.kill()
            raise ChildError(CRASHED, "the computing process sent invalid data and was stopped.")
        return event

    def _read(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as output:
            while line := output.readline(2**20):
                self._events.put(line)
                if not line.endswith(b"\n"):  # the line is too long, or the last one
                    break
        self._events.put(None)

    def _check_memory(self) -> None:
        try:
            used = psutil.Process(self._process.pid).memory_info().rss
        except psutil.Error:
            return
        if used > self._limits.memory_bytes:
            self.kill()
            raise ChildError("memory-limit", memory_words(self._limits.memory_bytes))

    def _death(self) -> ChildError:
        try:
            code = self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            self.kill()
            return ChildError(CRASHED, "the computing process stopped responding and was stopped.")
        if self._process.lost:
            return ChildError(
                LOST, "the fork server, which starts all computing processes, ended; try again."
            )
        if code == -signal.SIGXCPU:
            return ChildError(
                "cpu-limit",
                f"the fold exceeded its limit of {self._limits.cpu_s:g} s of processor time; try "
                "a smaller shape.",
            )
        if code < 0:
            name = signal.Signals(-code).name
            hint = " (often because the machine ran out of memory)" if name == "SIGKILL" else ""
            return ChildError(CRASHED, f"the computing process was ended by {name}{hint}.")
        return ChildError(CRASHED, f"the computing process ended with exit code {code}.")


def _too_slow(task: str, wall_s: float, *, slowed: bool) -> ChildError:
    if slowed:
        return ChildError(BUSY, "the machine is too busy; try again in a minute.")
    return ChildError(
        "time-limit",
        f"{STAGE_TEXTS.get(task, task)} exceeded its limit of {wall_s:g} s; try a smaller shape.",
    )


def _event(line: bytes) -> dict[str, Any] | None:
    """Return the event in a line; None if it is invalid, as from a compromised child."""
    try:
        event = json.loads(line)
        is_event = (
            isinstance(event.get("result", {}), dict) and EVENTS[event["event"]] <= event.keys()
        )
    except (ValueError, RecursionError, AttributeError, KeyError, TypeError):
        return None
    return event if is_event else None


class Children:
    """Children of one kind that are ended together.

    Args:
        kind: Kind of their tasks.
        limits: Resource limits of each.
        fork_server: Server that forks them; None to start them without one.
    """

    def __init__(self, kind: Kind, limits: ChildLimits, fork_server: ForkServer | None) -> None:
        self._kind: Kind = kind
        self._limits = limits
        self._fork_server = fork_server
        self._lock = threading.Lock()
        self._all: set[Child] = set()
        self._closed = False

    def take(self) -> Child:
        """Return a child for exclusive use; return it with ``release``.

        Raises:
            ChildError: If ``close`` was called.
        """
        with self._lock:
            if self._closed:
                raise ChildError(NO_START, "the service is stopping.")
            child = Child(self._kind, self._limits, fork_server=self._fork_server)
            self._all.add(child)
            return child

    def release(self, child: Child) -> None:
        """End a child that ``take`` has returned."""
        with self._lock:
            self._all.discard(child)
        child.close()

    def close(self) -> None:
        """End all children."""
        with self._lock:
            self._closed = True
            children, self._all = self._all, set()
        for child in children:
            child.close()


class Pool:
    """Children that are reused for short tasks; a child whose task fails is replaced.

    There is one for each concurrent call. Safe for use by several threads.

    Args:
        kind: Kind of their tasks.
        limits: Resource limits of each.
        wall_s: Limit of a task's wall time, s.
        fork_server: Server that forks them; None to start them without one.
        quota: Quota in which visitors take turns; if None, calls do not wait for each other.
    """

    def __init__(
        self,
        kind: Kind,
        limits: ChildLimits,
        *,
        wall_s: float,
        fork_server: ForkServer | None = None,
        quota: Quota | None = None,
    ) -> None:
        self._quota = quota
        self._children = Children(kind, limits, fork_server)
        self._wall_s = wall_s
        self._lock = threading.Lock()
        self._idle: list[Child] = []

    def call(
        self,
        task: str,
        directory: Path,
        *,
        visitor: str = "",
        cancelled: Callable[[], bool] | None = None,
    ) -> dict[str, Any]:
        """Run one task when it is the visitor's turn.

        Args:
            task: Name of a task of this kind of child.
            directory: Directory with the input.
            visitor: Visitor that requests it.
            cancelled: Polled; once it returns True, the task is stopped.

        Returns:
            Result of the task; its ``status`` is ``cancelled`` if it was stopped.

        Raises:
            InputError: If the input is invalid.
            ChildError: If the child crashed or exceeded a limit.
            ServiceError: If too many calls wait, of the visitor or in total.
        """
        if self._quota is None:
            return self._run(task, directory, cancelled)
        with self._quota.turn(visitor, unwanted=cancelled):
            return self._run(task, directory, cancelled)

    def _run(
        self, task: str, directory: Path, cancelled: Callable[[], bool] | None
    ) -> dict[str, Any]:
        for remaining_attempts in reversed(range(3)):
            child = self._take()
            try:
                result = child.call(
                    task,
                    directory,
                    wall_s=self._wall_s,
                    busy_factor=BUSY_FACTOR,
                    cancelled=cancelled,
                )
            except InputError:
                self._keep(child)
                raise
            except BaseException as error:
                self._children.release(child)
                if not (
                    isinstance(error, ChildError) and error.code == LOST and remaining_attempts
                ):
                    raise
            else:
                self._keep(child)
                return result
        raise AssertionError("unreachable: each attempt returns a result or raises an error")

    def close(self) -> None:
        """End all children."""
        self._children.close()

    def _take(self) -> Child:
        with self._lock:
            while self._idle:
                child = self._idle.pop()
                if child.alive:
                    return child
                self._children.release(child)
        return self._children.take()

    def _keep(self, child: Child) -> None:
        # The limit of processor time applies to the child's whole life. A cancellation may have
        # ended the child.
        if child.calls >= 200 or not child.alive:
            self._children.release(child)
            return
        with self._lock:
            self._idle.append(child)
