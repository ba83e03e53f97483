"""Starts: stop signals in the first seconds of a service, and the end of its processes."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import psutil

from bench.sections import Section
from tests.server.service_process import Service

MOMENTS_S: Final = tuple(k / 10 for k in range(1, 51))
"""Times from the start of the service to the signal, in s."""
MAX_END_S: Final = 6.0
"""Maximum time from the signal to the end of the last process of the service, in s."""
PR_SET_CHILD_SUBREAPER: Final = 36
"""Number of an option of prctl(2)."""
GIVE_UP_S: Final = 30.0
"""Time after a signal after which the remaining processes are killed, in s."""


def starts(short: bool = False) -> Section:
    """Measure how long all processes of a service take to end, with and without bytecode."""
    # A shell starts background jobs with SIGINT ignored, which this process would pass on.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # Processes whose parent has ended become children of this one.
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    section = Section(name="starts")
    moments = MOMENTS_S[::10] if short else MOMENTS_S
    for warm in (True, False):
        for number in (signal.SIGTERM, signal.SIGINT):
            took = {at: _end_s(at, number, warm=warm) for at in moments}
            name = f"{number.name}, {'warm' if warm else 'cold'}"
            section.rows += [
                {"start": name, "signal after, s": at, "end, s": took[at]} for at in took
            ]
            section.add(
                f"longest end, {name}",
                f"{max(took.values()):.2f} s of {len(took)}",
                f"≤ {MAX_END_S:g} s",
                max(took.values()) <= MAX_END_S,
            )
    return section


def _end_s(at_s: float, number: signal.Signals, *, warm: bool) -> float:
    """Return the seconds from a signal to the end of all processes of a service."""
    with TemporaryDirectory(prefix="foldback-starts-") as place:
        environment = {} if warm else {"PYTHONPYCACHEPREFIX": f"{place}/bytecode"}
        service = Service(Path(place) / "data", environment=environment, prewarm=True, workers=2)
        service.data_dir.mkdir()
        with open(service.log, "a") as log:
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", "foldback.server.cli", "serve"],
                env=service.environment,
                stdout=log,
                stderr=log,
            )
        time.sleep(at_s)
        process.send_signal(number)
        sent = time.monotonic()
        while process.poll() is None or _others(process.pid):
            if time.monotonic() - sent > GIVE_UP_S:
                for remaining in psutil.Process().children(recursive=True):
                    remaining.kill()
            time.sleep(0.02)
        return time.monotonic() - sent


def _others(pid: int) -> list[psutil.Process]:
    """Return the running descendants of this process, except one, and collect ended ones."""
    computed_process: list[psutil.Process] = []
    for process in psutil.Process().children(recursive=True):
        try:
            if process.status() != psutil.STATUS_ZOMBIE:
                computed_process.append(process)
            elif process.pid != pid and process.ppid() == os.getpid():
                os.waitpid(process.pid, 0)
        except psutil.NoSuchProcess:
            continue
    return computed_process
