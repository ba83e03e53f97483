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
from pathlib import Path
from typing import Any, Final

import psutil

LOOK_S: Final = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One run of ``foldback fold``.

    Attributes:
        summary: Its JSON object.
        code: Its exit code.
        wall_s: From start to end of the process, imports included.
        peak_mb: Most memory that was resident, of it and the processes that it starts; what they
            share counts for each.
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
        seen: list[int] = []
        watch = threading.Thread(target=_watch, args=(process.pid, seen))
        watch.start()
        output = process.stdout.read()
        _, status, usage = os.wait4(process.pid, 0)
        wall_s = time.perf_counter() - begun
        process.returncode = os.waitstatus_to_exitcode(status)
        watch.join()
    return Run(
        summary=json.loads(output.splitlines()[-1]),
        code=process.returncode,
        wall_s=wall_s,
        peak_mb=max(usage.ru_maxrss * 1024, *seen, 0) / 2**20,
    )


def _environment() -> dict[str, str]:
    """As people have it, who keep what Python compiles of what it imports."""
    return {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}


def _watch(pid: int, seen: list[int]) -> None:
    """Bytes that a process and those that it has started hold, until it ends."""
    with suppress(psutil.Error):
        process = psutil.Process(pid)
        while process.is_running() and process.status() != psutil.STATUS_ZOMBIE:
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
