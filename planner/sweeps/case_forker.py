"""Case forker: the program that forks a process for each case, with the planner loaded.

It computes nothing itself, and has one thread, because a fork does not copy other threads. Over a
connection it receives pickled cases, one at a time. It answers with the number of the process, and
at its end with its exit status, processor time (s), peak memory (bytes) and pickled outcome.
"""

from __future__ import annotations

import ctypes
import gc
import os
import pickle
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Collection
from contextlib import suppress
from importlib import import_module
from itertools import islice
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Final, NoReturn

from foldback.planner.sweeps.case import ERROR, MEMORY_LIMIT, Case, Outcome, Value

CPU_GRACE_S: Final = 10
"""Processor time, in s, that a case may take beyond twice its limit, to store what it has."""
PRELOADED: Final = ("foldback.planner.pipeline.stages",)
"""Modules that are loaded before the first case. Others are loaded here after the first case that
has loaded them, so that later cases have them at once."""
READ_BYTES: Final = 2**20
"""Number of bytes of an outcome that are read at once."""
PARENT_DEATH_SIGNAL: Final = 1
"""``PR_SET_PDEATHSIG`` of Linux: the operation of ``prctl`` that sets the signal which a process
gets when its parent ends."""


def main() -> None:
    """Compute cases until the connection in the first argument ends."""
    cases = Connection(int(sys.argv[1]))
    # Signals to a whole group are for its worker; without the worker, this process ends.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    _load(PRELOADED)
    while True:
        try:
            pickled = cases.recv_bytes()
        except (EOFError, ConnectionError):
            return
        with tempfile.TemporaryDirectory(prefix="foldback-case-") as scratch:
            exit_status, used, answer = _compute_in_child(pickled, scratch, cases)
        is_whole = answer and exit_status == 0  # a library may call os._exit(0)
        outcome, modules = pickle.loads(answer) if is_whole else (b"", ())
        memory_bytes = used.ru_maxrss * (1 if sys.platform == "darwin" else 1024)
        with suppress(ConnectionError):
            cases.send((exit_status, used.ru_utime + used.ru_stime, memory_bytes, outcome))
        _load(modules)


def _load(modules: Collection[str]) -> None:
    """Import modules, and let children share all objects."""
    for name in modules:
        with suppress(Exception):  # the case that needs it says so
            import_module(name)
    if modules:
        # A garbage collector in a child would copy the memory of the objects that it visits.
        gc.collect()
        gc.freeze()


def _compute_in_child(
    pickled: bytes, scratch: str, cases: Connection
) -> tuple[int, resource.struct_rusage, bytes]:
    reader, writer = os.pipe()
    pid = os.fork()
    if not pid:
        os.close(reader)
        cases.close()
        _be_child(pickled, scratch, writer)
    os.close(writer)
    with suppress(PermissionError, ProcessLookupError):
        os.setpgid(pid, pid)  # as the child does, whoever is first
    chunks: list[bytes] = []
    with suppress(ConnectionError):
        cases.send(pid)
        while cases not in wait([reader, cases]):  # a connection without a case is at its end
            if not (chunk := os.read(reader, READ_BYTES)):
                break
            chunks.append(chunk)
    os.close(reader)
    with suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGKILL)
    _, status, used = os.wait4(pid, 0)
    return os.waitstatus_to_exitcode(status), used, b"".join(chunks)


def _be_child(pickled: bytes, scratch: str, writer: int) -> NoReturn:
    """Compute a case in this process, write its outcome and end."""
    exit_status = 1
    try:
        _confine(scratch)
        loaded = len(sys.modules)
        outcome = pickle.dumps(_outcome_of(pickled))
        # The last ones alone: looking at all would copy their memory, 1.5 ms.
        modules = tuple(islice(reversed(sys.modules), max(len(sys.modules) - loaded, 0)))[::-1]
        answer = memoryview(pickle.dumps((outcome, modules)))
        while answer:
            answer = answer[os.write(writer, answer) :]
        exit_status = 0
    finally:
        os._exit(exit_status)


def _confine(scratch: str) -> None:
    os.setpgid(0, 0)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PARENT_DEATH_SIGNAL, signal.SIGKILL)
        with suppress(OSError):  # if memory runs out, a case ends before its worker
            Path("/proc/self/oom_score_adj").write_text("500")
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    tempfile.tempdir = scratch  # is removed even if the case crashes


def _outcome_of(pickled: bytes) -> Outcome:
    try:
        case: Case = pickle.loads(pickled)
        max_cpu_s = int(2 * case.limits.cpu_s) + CPU_GRACE_S
        resource.setrlimit(resource.RLIMIT_CPU, (max_cpu_s, max_cpu_s + 1))
        result = case.task(lambda: time.process_time() > case.limits.cpu_s)
        outcome = result if isinstance(result, Outcome) else Outcome(row=result)
        for column, value in outcome.row.items():
            if not isinstance(value, Value):  # pyright: ignore[reportUnnecessaryIsInstance]
                raise TypeError(f"got {value!r} in the column {column!r}, expected {Value}")
    except MemoryError:
        return Outcome(row={"verdict": MEMORY_LIMIT})
    except BaseException as error:  # also sys.exit() of a library: a row, and the sweep goes on
        return Outcome(row={"verdict": ERROR, "error": f"{type(error).__name__}: {error}"})
    return outcome


if __name__ == "__main__":
    main()
