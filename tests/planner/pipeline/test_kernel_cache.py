"""Machine code of kernels on disk: when it is used, and when it is out of date."""
# pyright: reportPrivateUsage=false

from __future__ import annotations

import ast
import importlib
import shutil
from pathlib import Path
from typing import Any

import pytest
from numba.core.caching import IndexDataCacheFile
from numba.core.dispatcher import Dispatcher

from planner import kernel_cache
from planner.kernel_cache import KERNELS, sources, sources_digest
from tests.case import case

FILES = sorted(path for path in KERNELS.glob("*.py") if path.name != "__init__.py")


def imported(path: Path) -> set[Path]:
    """Return the files of kernels that a file imports, by its syntax tree."""
    return {
        KERNELS / f"{node.module.rpartition('.')[2]}.py"
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom)
        and node.module is not None
        and node.module.startswith("planner.kernels.")
    }


def test_sources_of_a_kernel_hold_all_its_imports() -> None:
    for path in FILES:
        with case(path.stem):
            assert path in sources(path)
            for source in sources(path):
                assert imported(source) <= set(sources(path))
                # What another package defines would not be compared.
                modules = [
                    node.module or ""
                    for node in ast.parse(source.read_text()).body
                    if isinstance(node, ast.ImportFrom)
                ]
                assert all(
                    not m.startswith("planner") or m.startswith("planner.kernels") for m in modules
                )


def test_digest_changes_with_a_file_that_is_imported_by_an_imported_one(tmp_path: Path) -> None:
    for path in FILES:
        shutil.copy(path, tmp_path)
    sweep, kinematics = tmp_path / "sweep.py", tmp_path / "kinematics.py"
    assert kinematics in sources(sweep) and kinematics not in imported(KERNELS / "sweep.py")
    before = sources_digest(sweep)
    kinematics.write_text(kinematics.read_text() + "# another step\n")
    sources_digest.cache_clear()
    assert sources_digest(sweep) != before
    shutil.copy(KERNELS / "kinematics.py", tmp_path)
    sources_digest.cache_clear()
    assert sources_digest(sweep) == before == sources_digest(KERNELS / "sweep.py")


def test_every_kernel_compares_all_its_sources() -> None:
    for path in FILES:
        with case(path.stem):
            module = importlib.import_module(f"planner.kernels.{path.stem}")
            for kernel in vars(module).values():
                if isinstance(kernel, Dispatcher) and kernel.py_func.__module__ == module.__name__:
                    cache: Any = vars(kernel)["_cache"]
                    file = cache._cache_file
                    assert file._source_stamp == sources_digest(path)
                    assert sources_digest(path) in file._version


def test_index_of_other_sources_that_names_a_type_that_is_gone_is_not_read(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    gone = type("Gone", (), {"__module__": kernel_cache.__name__})
    monkeypatch.setattr(kernel_cache, "Gone", gone, raising=False)
    IndexDataCacheFile(str(tmp_path), "kernel", "old")._save_index({gone: "kernel.1.nbc"})
    monkeypatch.undo()
    assert IndexDataCacheFile(str(tmp_path), "kernel", "new").load("key") is None
    with pytest.raises(AttributeError):
        IndexDataCacheFile(str(tmp_path), "kernel", "old").load("key")
