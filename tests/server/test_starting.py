"""What is said when the service can't start, and what to do."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from server import worker
from server.commands.serve import server_of
from server.settings import Settings

MISSING = [
    ({"database_url": "postgresql://nobody@127.0.0.1:1/none"}, "the database does not answer"),
    ({"storage_url": "nonsense://bucket"}, "expected something like s3://bucket/prefix"),
]


@pytest.mark.parametrize("start", [server_of, worker.work])
@pytest.mark.parametrize(("settings", "words"), MISSING)
def test_what_is_missing_and_what_to_do(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    start: Callable[[Settings], object],
    settings: dict[str, str],
    words: str,
) -> None:
    for name in ("keep_secrets", "set_up_logs"):  # of the process, which is that of the tests
        monkeypatch.setattr(worker, name, lambda *_: None)
    with pytest.raises(SystemExit) as ended:
        start(Settings(data_dir=tmp_path, **settings))  # type: ignore[arg-type]
    assert ended.value.code == 1
    said = capsys.readouterr().err
    assert words in said and "foldback doctor" in said


@pytest.mark.processes
@pytest.mark.parametrize("command", ["serve", "worker"])
def test_one_line_and_what_to_do(command: str) -> None:
    environment = {k: v for k, v in os.environ.items() if not k.startswith("FOLDBACK_")}
    environment |= {"FOLDBACK_DATA_DIR": "/proc/foldback", "FOLDBACK_WORKERS": "0"}
    done = subprocess.run(
        [sys.executable, "-P", "-m", "server.command_line", command],
        env=environment,
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 1
    assert "cannot be used" in done.stderr
    assert "foldback doctor" in done.stderr
    assert "Traceback" not in done.stderr
