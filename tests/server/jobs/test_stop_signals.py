"""A stop signal ends a worker, whichever of its threads the kernel delivers it to."""

import ctypes
import os
import platform
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from tests.server.service_process import TIMEOUT_S

pytestmark = pytest.mark.processes
TGKILL = {"x86_64": 234, "aarch64": 131}[platform.machine()]
"""System call that sends a signal to one thread."""


def test_signal_to_another_thread_ends_a_worker(tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-P", "-m", "foldback.server.cli", "worker"],
        env={**os.environ, "FOLDBACK_DATA_DIR": str(tmp_path)},
        stderr=subprocess.PIPE,
        text=True,
    ) as worker:
        try:
            assert worker.stderr is not None
            assert any("is ready" in line for line in worker.stderr)
            other_thread = max(thread.id for thread in psutil.Process(worker.pid).threads())
            assert other_thread != worker.pid
            ctypes.CDLL(None).syscall(TGKILL, worker.pid, other_thread, signal.SIGTERM)
            assert worker.wait(TIMEOUT_S) == 0
        finally:
            worker.kill()
