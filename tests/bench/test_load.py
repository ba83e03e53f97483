"""The short forms of `make load`: that nothing fails, not how quick it is."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from bench.load.loopback import NotHereError, checked
from bench.load.mutated import mutated_uploads
from bench.load.scrubbing import scrubbing
from bench.load.strangers import strangers
from bench.load.uploads import uploads
from bench.load.viewers import viewers
from bench.load.workers import workers

LONG = pytest.mark.long


@pytest.mark.parametrize("address", ["http://192.0.2.1", "http://[2001:db8::1]:80", "http://", ""])
def test_load_goes_to_this_machine_only(address: str) -> None:
    with pytest.raises(NotHereError, match="expected a service on 127.0.0.1"):
        checked(address)
    assert checked("http://127.0.0.1:8000") == "http://127.0.0.1:8000"


@LONG
@pytest.mark.parametrize(
    "section",
    [scrubbing, uploads, mutated_uploads, strangers, viewers, workers],
    ids=lambda s: s.__name__,
)
def test_load_section_in_short(section) -> None:
    found = section(True)
    missed = [figure for figure in found.figures if figure.met is False]
    assert not missed, missed
    assert any(figure.met for figure in found.figures) or found.rows


@LONG
def test_faults_in_short(tmp_path: Path) -> None:
    done = subprocess.run(
        [
            *(sys.executable, "-m", "bench.load", "--only", "faults", "--short"),
            *("--out", str(tmp_path / "load.json")),
        ],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
