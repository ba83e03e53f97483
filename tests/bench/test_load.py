"""Short form of `make load`: checks that nothing fails, not how fast it is."""

import subprocess
import sys
from pathlib import Path

import pytest

from bench.load.loopback import NotHereError, checked

SECTIONS = ("scrubbing", "uploads", "mutated", "strangers", "takeover", "viewers", "workers")


def test_load_goes_to_this_machine_only() -> None:
    for address in ("http://192.0.2.1", "http://[2001:db8::1]:80", "http://", ""):
        with pytest.raises(NotHereError, match="expected a service on 127.0.0.1"):
            checked(address)
    assert checked("http://127.0.0.1:8000") == "http://127.0.0.1:8000"


@pytest.mark.long
@pytest.mark.parametrize(
    "options", [("--short", "--only", *SECTIONS), ("--rounds", "12", "--only", "faults", "several")]
)
def test_load_in_short_meets_its_bars(options: tuple[str, ...], tmp_path: Path) -> None:
    """The number of rounds equals the number of faults, so that each fault happens once."""
    load = [sys.executable, "-m", "bench.load", *options, "--out", str(tmp_path / "load.json")]
    done = subprocess.run(load, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
