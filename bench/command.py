"""Runs the command line in a fresh process and measures it."""

from __future__ import annotations

import json
import os
import re
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

LOOK_S: Final = 0.02
PEAK: Final = re.compile(r"VmHWM:\s*(\d+) kB")
LOOKS: Final = 10
"""Looks at the process alone for one at those that it has started, too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One run of ``foldback fold``.

    Attributes:
        summary: Its JSON object.
        code: Its exit code.
        wall_s: From start to end of the process, imports included.
        peak_mb: Most memory that was resident, of it, and now and then of it and the processes
            that it has started; what they share counts for each.
    """

    summary: dict[str, Any]
    code: int
    wall_s: float
    peak_mb: float


def fold(shape: str, *options: str, out: Path | None = None) -> Run:
    """Folds an example shape or a file in a process of its own, and keeps the plan in ``out``."""
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as directory:
        command = [
            *(sys.executable, "-m", "server.cli.command_line", "fold", shape),
            *("--out", str(out or Path(directory) / "fold"), "--json", *options),
        ]
        begun = time.perf_counter()
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=_environment()
        )
        assert process.stdout is not None
        with watched(process.pid) as seen:
            output = process.stdout.read()
            code = process.wait()
            wall_s = time.perf_counter() - begun
    return Run(
        summary=json.loads(output.splitlines()[-1]),
        code=code,
        wall_s=wall_s,
        peak_mb=max(seen) / 2**20,
    )


def _environment() -> dict[str, str]:
    """As people have it, who keep what Python compiles of what it imports."""
    return {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}


@contextmanager
def watched(pid: int) -> Iterator[list[int]]:
    """Bytes that a process, or it and those that it has started, have held until it ends.

    ``ru_maxrss`` will not do: it counts what the process that has started it held by then.
    """
    seen = [0]
    watch = threading.Thread(target=_watch, args=(pid, seen))
    watch.start()
    try:
        yield seen
    finally:
        watch.join()


def _watch(pid: int, seen: list[int]) -> None:
    status = Path(f"/proc/{pid}/status")
    with suppress(psutil.Error, OSError):
        process = psutil.Process(pid)
        for look in count():
            # It has no such line any more when it has ended.
            if (found := PEAK.search(status.read_text())) is None:
                return
            seen.append(1024 * int(found.group(1)))
            if look % LOOKS == 0:
                every = [process, *process.children(recursive=True)]
                seen.append(sum(one.memory_info().rss for one in every))
            time.sleep(LOOK_S)


@contextmanager
def playing(directory: Path) -> Iterator[str]:
    """``foldback play`` on a directory; the address of its page."""
    process = subprocess.Popen(
        [sys.executable, "-m", "server.cli.command_line", "play", str(directory), "--no-browser"],
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
