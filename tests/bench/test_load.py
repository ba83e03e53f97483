"""The short form of `make load`: that nothing fails, not how quick it is."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from bench.load.loopback import NotHereError, checked

SECTIONS = ("scrubbing", "uploads", "mutated", "strangers", "viewers", "workers")


def test_load_goes_to_this_machine_only() -> None:
    for address in ("http://192.0.2.1", "http://[2001:db8::1]:80", "http://", ""):
        with pytest.raises(NotHereError, match="expected a service on 127.0.0.1"):
            checked(address)
    assert checked("http://127.0.0.1:8000") == "http://127.0.0.1:8000"


@pytest.mark.long
@pytest.mark.parametrize(
    "asked", [("--short", "--only", *SECTIONS), ("--rounds", "12", "--only", "faults", "several")]
)
def test_load_in_short_meets_its_bars(asked: tuple[str, ...], tmp_path: Path) -> None:
    """In as many rounds as there are faults, each happens once."""
    load = [sys.executable, "-m", "bench.load", *asked, "--out", str(tmp_path / "load.json")]
    done = subprocess.run(load, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
