"""Commands run in fresh processes, with their time and memory measured."""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, Final

import psutil

MEMORY_POLL_S: Final = 0.02
"""Time between two readings of the memory of a measured command, in s."""
PEAK_MEMORY_LINE: Final = re.compile(r"VmHWM:\s*(\d+) kB")
"""Matches the line of ``/proc/PID/status`` with the peak resident memory, kB."""
POLLS_PER_TREE_READING: Final = 10
"""Number of memory readings of the measured process for each one that also adds up its child
processes, which is slower."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One run of ``foldback fold``.

    Attributes:
        summary: JSON object that the command prints.
        code: Exit code.
        wall_s: Seconds from the start to the end of the process, imports included.
        processor_s: Processor time of the process and of its children, s.
        peak_mb: Peak resident memory of the process, or of it and its children together, MiB.
            Memory that processes share counts for each of them.
    """

    summary: dict[str, Any]
    code: int
    wall_s: float
    processor_s: float
    peak_mb: float


def fold(shape: str, *options: str, out: Path | None = None) -> Run:
    """Fold an example shape or a file in a separate process; write the plan to ``out``."""
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as directory:
        command = [
            *(sys.executable, "-m", "foldback.server.cli.command_line", "fold", shape),
            *("--out", str(out or Path(directory) / "fold"), "--json", *options),
        ]
        start_s, used_s = time.perf_counter(), _children_seconds()
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=_environment()
        )
        assert process.stdout is not None
        with watched(process.pid) as readings:
            output = process.stdout.read()
            code = process.wait()
            wall_s = time.perf_counter() - start_s
    return Run(
        summary=json.loads(output.splitlines()[-1]),
        code=code,
        wall_s=wall_s,
        processor_s=_children_seconds() - used_s,
        peak_mb=max(readings) / 2**20,
    )


def _children_seconds() -> float:
    """Return the processor time of the ended children of this process, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _environment() -> dict[str, str]:
    """Return the environment without ``PYTHONDONTWRITEBYTECODE``.

    The benchmark stores compiled bytecode, as users do.
    """
    return {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}


@contextmanager
def watched(pid: int) -> Iterator[list[int]]:
    """Record the resident memory of a process, and of it with its children, until it ends; bytes.

    ``ru_maxrss`` is unsuitable: it includes the parent's memory at the time of the fork.
    """
    readings = [0]
    watch = threading.Thread(target=_watch, args=(pid, readings))
    watch.start()
    try:
        yield readings
    finally:
        watch.join()


def _watch(pid: int, readings: list[int]) -> None:
    status = Path(f"/proc/{pid}/status")
    with suppress(psutil.Error, OSError):
        process = psutil.Process(pid)
        for poll in count():
            # A process that has ended has no such line.
            if (line := PEAK_MEMORY_LINE.search(status.read_text())) is None:
                return
            readings.append(1024 * int(line.group(1)))
            if poll % POLLS_PER_TREE_READING == 0:
                every = [process, *process.children(recursive=True)]
                readings.append(sum(running.memory_info().rss for running in every))
            time.sleep(MEMORY_POLL_S)


@contextmanager
def playing(directory: Path) -> Iterator[str]:
    """Run ``foldback play`` on a directory; yield the address of its page."""
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "foldback.server.cli.command_line",
            "play",
            str(directory),
            "--no-browser",
        ],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    try:
        address = re.search(r"http://\S+", process.stdout.readline())
        assert address, "it did not start"
        yield address.group()
    finally:
        process.terminate()
        process.communicate(timeout=30)
