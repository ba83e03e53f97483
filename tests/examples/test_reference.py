"""Example of the README, and the reference made from docstrings."""

import inspect
from importlib import import_module
from pathlib import Path

import pytest

from docs.make_reference import MODULES, ROOT, example, make, value_docstring
from tests.case import case

PUBLIC = [(name, public) for name in MODULES for public in import_module(name).__all__]


@pytest.mark.slow
def test_example_of_the_readme_runs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code = example()
    assert 8 <= len([line for line in code.splitlines() if line]) <= 10
    monkeypatch.chdir(ROOT)
    exec(compile(code, "README.md", "exec"), {})
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "verified (simulated)"
    assert 0.0 < float(lines[1]) <= float(lines[2])


def test_public_values_have_docstrings() -> None:
    """`make lint` requires docstrings of public classes, functions and methods."""
    for module, name in PUBLIC:
        documented_object = getattr(import_module(module), name)
        if not (inspect.isclass(documented_object) or inspect.isroutine(documented_object)):
            with case(f"{module}.{name}"):
                assert value_docstring(import_module(module), name)


@pytest.mark.slow
def test_reference_has_every_public_name(tmp_path: Path) -> None:
    make(tmp_path)  # a warning is an error here
    assert "foldback.html" in (tmp_path / "index.html").read_text(encoding="utf-8")
    assert 'id="Show.__call__"' in (tmp_path / "foldback" / "viewer.html").read_text(
        encoding="utf-8"
    )
    for module, name in PUBLIC:
        page = (tmp_path / f"{module.replace('.', '/')}.html").read_text(encoding="utf-8")
        assert f'<section id="{name}">' in page
    assert "min_clearance" in example()
    page = (tmp_path / "foldback.html").read_text(encoding="utf-8")
    assert "wrench-94.json" in page.partition('<section id="')[0]
    assert "sets of parameters" in page
