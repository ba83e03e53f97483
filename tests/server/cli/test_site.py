"""Refusals of `foldback site`; tests/browser/test_site_files.py opens the files that it writes."""

import json
from pathlib import Path

import pytest
import typer

from server.cli.site import site


@pytest.mark.parametrize(
    ("given", "code"),
    [
        ({"service": "javascript:alert(1)"}, "bad-service"),
        ({"service": "https://"}, "bad-service"),
        ({"folds": [Path("nothing-here")]}, "no-fold"),
        ({}, "no-folds"),
    ],
)
def test_site_refuses_unusable_input(
    given: dict[str, object], code: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(typer.Exit) as ended:
        site(tmp_path, **given, finished=False, as_json=True)  # type: ignore[arg-type]
    assert ended.value.exit_code == 2
    assert json.loads(capsys.readouterr().out)["error"]["code"] == code
    assert list(tmp_path.iterdir()) == []
