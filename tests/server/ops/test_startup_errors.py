"""Messages when the service cannot start, with a remedy."""

from itertools import product
from pathlib import Path

import pytest

from foldback.server.cli.serve import server_of
from foldback.server.jobs import worker
from foldback.server.settings import Settings
from tests.server.cli.test_command_line import foldback

MISSING = [
    ({"database_url": "postgresql://nobody@127.0.0.1:1/none"}, "the database is not available"),
    ({"storage_url": "nonsense://bucket"}, "expected something like s3://bucket/prefix"),
]


@pytest.mark.usefixtures("process_state")
def test_missing_database_or_storage_is_reported_with_a_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for start, (settings, words) in product((server_of, worker.work), MISSING):
        with pytest.raises(SystemExit) as ended:
            start(Settings(data_dir=tmp_path, **settings))  # type: ignore[arg-type]
        assert ended.value.code == 1
        output = capsys.readouterr().err
        assert words in output and "foldback doctor" in output


@pytest.mark.usefixtures("without_settings", "process_state")
@pytest.mark.parametrize("command", ["serve", "worker"])
def test_unusable_data_directory_is_reported_with_a_remedy(
    command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FOLDBACK_DATA_DIR", "/proc/foldback")
    monkeypatch.setenv("FOLDBACK_WORKERS", "0")
    done = foldback(command)
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert "cannot be used" in done.stderr and "foldback doctor" in done.stderr
