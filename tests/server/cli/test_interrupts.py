"""Interrupts reach a command wherever they come."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

LOST = "try:\n    ready()\n    time.sleep(0.5)\nexcept KeyboardInterrupt:\n    print('lost')"
"""Statements that lose an interrupt, as extension modules do."""
PROGRAM = """
import ctypes, sys, time
from foldback.server.cli.interrupts import Interrupts

def ready():
    print("ready", flush=True)

def callback():  # ctypes ignores the exception
    ready()
    time.sleep(0.5)

Interrupts().handle()
try:
    CODE
    time.sleep(60)
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


@pytest.mark.parametrize(
    "code",
    [
        "import losing",
        "ctypes.CFUNCTYPE(None)(callback)()",
        "ready()",
    ],
)
def test_interrupt_is_not_lost(code: str, tmp_path: Path) -> None:
    """An import waits, and an interrupt that a callback loses comes again."""
    losing = "import time\nfrom __main__ import ready\n" + LOST
    (tmp_path / "losing.py").write_text(losing)
    program = tmp_path / "program.py"
    program.write_text(PROGRAM.replace("CODE", code))
    with subprocess.Popen(
        [sys.executable, str(program)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        process.send_signal(signal.SIGINT)
        assert process.stdout.read() == "interrupted\n"
    assert process.returncode == 0
