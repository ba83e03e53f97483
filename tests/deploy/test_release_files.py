"""``make release-files``: its steps and their options exist."""

import pytest

from docs import make_release_files
from tests.run_python import ROOT


def test_dry_run_lists_programs_and_options_that_exist(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["make_release_files", "--dry-run"])
    make_release_files.main()
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(make_release_files.STEPS)
    for line, (name, module, *arguments) in zip(lines, make_release_files.STEPS, strict=True):
        assert line.startswith(f"{name}: python -m {module}")
        folder = ROOT / module.replace(".", "/")
        program = folder / "__main__.py" if folder.is_dir() else folder.with_suffix(".py")
        source = program.read_text(encoding="utf-8")
        assert all(f'"{argument}"' in source for argument in arguments)
