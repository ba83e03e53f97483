"""What is said when the service can't start: one line, and what to do."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.parametrize("command", ["serve", "worker"])
@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"DATABASE_URL": "postgresql://nobody@127.0.0.1:1/none"}, "the database does not answer"),
        ({"STORAGE_URL": "nonsense://bucket"}, "expected something like s3://bucket/prefix"),
        ({"DATA_DIR": "/proc/foldback"}, "cannot be used"),
    ],
)
def test_one_line_and_what_to_do(
    tmp_path: Path, command: str, settings: dict[str, str], words: str
) -> None:
    environment = {k: v for k, v in os.environ.items() if not k.startswith("FOLDBACK_")}
    environment |= {"FOLDBACK_DATA_DIR": str(tmp_path), "FOLDBACK_WORKERS": "0"}
    environment |= {f"FOLDBACK_{name}": value for name, value in settings.items()}
    done = subprocess.run(
        [
            sys.executable,
            "-P",
            "-m",
            "server.command_line",
            command,
            *(["--port", "0"] * (command == "serve")),
        ],
        env=environment,
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 1
    assert words in done.stderr
    assert "foldback doctor" in done.stderr
    assert "Traceback" not in done.stderr
