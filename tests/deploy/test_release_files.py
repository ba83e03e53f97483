"""``make release-files``: its steps exist."""

from importlib.util import find_spec

import pytest

from docs import make_release_files


def test_dry_run_lists_modules_that_exist(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["make_release_files", "--dry-run"])
    make_release_files.main()
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(make_release_files.STEPS)
    for line, (name, module, *_) in zip(lines, make_release_files.STEPS, strict=True):
        assert line.startswith(f"{name}: python -m {module}")
        assert find_spec(module) is not None
