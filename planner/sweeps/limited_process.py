"""Limited process: a case is computed in a process of its own, and whatever happens is a row."""

from __future__ import annotations

import os
import pickle
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import BrokenExecutor
from contextlib import suppress
from datetime import UTC, datetime
from functools import cache
from multiprocessing.connection import Connection
from typing import Final

from foldback.planner.progress import never
from foldback.planner.sweeps.case import ERROR, MEMORY_LIMIT, TIME_LIMIT, Case, Outcome, Row
from foldback.planner.sweeps.planner_digest import planner_digest

POLL_S: Final = 0.05
"""Time, in s, between two readings of the memory of a case's process."""
FORKER_ENVIRONMENT: Final = {
    # Threads of a library do not survive a fork.
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    # Huge pages: a fork copies fewer page tables, 9 instead of 12 ms of processor for each case.
    "GLIBC_TUNABLES": "glibc.malloc.hugetlb=1",
}
"""Environment of case forkers, unless the environment of their worker says otherwise."""


def run_limited(case: Case, is_unwanted: Callable[[], bool] = never) -> Outcome:
    """Compute a case in a process with limits; return its row, and the files of its plan.

    A crash, a breach of a limit and an error are rows, too. Later cases of this process start
    faster than its first one, which loads the planner.

    Args:
        case: The case.
        is_unwanted: Asked periodically whether nobody waits for the row, so that the computation
            ends.

    Raises:
        BrokenExecutor: If the planner here is another one than that of the command.
    """
    if case.planner_digest not in ("", planner_digest()):
        raise BrokenExecutor(
            f"got another version of foldback on {socket.gethostname()}, expected the same version "
            "of foldback as that of the command; install it there, and start the workers again."
        )
    started_at = datetime.now(UTC).isoformat(timespec="seconds")
    start_s = time.monotonic()
    outcome = _compute(case, is_unwanted)
    about: Row = {
        "wall_s": round(time.monotonic() - start_s, 3),
        "host": socket.gethostname(),
        "processor": _processor(),
        "started_at": started_at,
    }
    row = {"key": case.key, **case.columns, **about, **outcome.row}
    return Outcome(row=row, files=outcome.files)


def _compute(case: Case, is_unwanted: Callable[[], bool]) -> Outcome:
    error = ""
    # Again if the forker was killed, for example by the kernel, which may have killed others, too.
    for take_forker in (_idle_forker, _Forker):
        try:
            forker = take_forker()
            outcome = forker.compute(case, is_unwanted)
            _idle.append(forker)
            return outcome
        except Exception as problem:
            error = f"{type(problem).__name__}: {problem}"
    return Outcome(row={"verdict": ERROR, "error": error})


class _Forker:
    """Case forker of this process, which computes one case at a time."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "foldback.planner.sweeps.case_forker", str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=2,  # the command's output is for rows
                env=FORKER_ENVIRONMENT | os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
            )
        self._cases = Connection(ours.detach())

    def close(self) -> None:
        """End the forker, and what it computes."""
        self._cases.close()
        self._process.wait()

    def compute(self, case: Case, is_unwanted: Callable[[], bool]) -> Outcome:
        """Return the outcome of a case, without the columns that all cases have.

        Raises:
            EOFError, OSError: If the forker has ended.
        """
        try:
            self._cases.send_bytes(pickle.dumps(case))
            pid = int(self._cases.recv())
            breach = self._wait(pid, case, is_unwanted)
            exit_status, cpu_s, memory_bytes, pickled = self._cases.recv()
        except BaseException:
            self.close()
            raise
        if pickled:
            outcome: Outcome = pickle.loads(pickled)
        else:
            outcome = Outcome(row={"verdict": breach or _verdict_of(exit_status)})
        used: Row = {"cpu_s": round(cpu_s, 3), "memory_mb": round(memory_bytes / 2**20, 1)}
        return Outcome(row=used | outcome.row, files=outcome.files)

    def _wait(self, pid: int, case: Case, is_unwanted: Callable[[], bool]) -> str:
        """Wait until a case has ended; return the limit because of which it was killed."""
        end_s = time.monotonic() + case.limits.wall_s
        breach = ""
        while not self._cases.poll(POLL_S):
            if time.monotonic() > end_s:
                breach = TIME_LIMIT
            elif _resident_bytes(pid) > case.limits.memory_bytes:
                breach = MEMORY_LIMIT
            elif is_unwanted():
                breach = "not wanted"
            if breach:
                with suppress(ProcessLookupError, PermissionError):
                    os.killpg(pid, signal.SIGKILL)
        return breach


_idle: list[_Forker] = []
"""Case forkers of this process that compute nothing now. They end with it."""

os.register_at_fork(after_in_child=_idle.clear)


def _idle_forker() -> _Forker:
    """Return a forker that has computed before, or a new one if none is idle."""
    with suppress(IndexError):
        return _idle.pop()
    return _Forker()


def _resident_bytes(pid: int) -> int:
    import psutil  # of the extra ``sweep``

    with suppress(psutil.Error):
        return psutil.Process(pid).memory_info().rss
    return 0


def _verdict_of(exit_status: int) -> str:
    if exit_status == -signal.SIGXCPU:
        return TIME_LIMIT
    if exit_status < 0:
        return f"crashed ({signal.Signals(-exit_status).name})"
    return f"crashed (exit status {exit_status})"


@cache
def _processor() -> str:
    """Return the name of this machine's processor; empty if the system does not state it."""
    with suppress(OSError, StopIteration), open("/proc/cpuinfo", encoding="utf-8") as lines:
        return next(line.split(":")[1].strip() for line in lines if "model name" in line)
    return ""
