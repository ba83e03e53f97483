"""Lock of the compilation, and kernels that Python must not call."""

import ast
import gc
import importlib
import importlib.util
import shutil
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numba import njit
from numba.core.caching import IndexDataCacheFile
from numba.core.dispatcher import Dispatcher

from foldback.planner.compilation import compiling_lock, kernel_cache
from foldback.planner.compilation.compiling import GC_THRESHOLD_OBJECTS, Compiling
from foldback.planner.compilation.compiling_lock import (
    FIRST_LOCK,
    CompilingLock,
    compiling_fraction,
)
from foldback.planner.compilation.inner_kernels import InnerLibrary
from foldback.planner.compilation.kernel_cache import KERNELS, sources, sources_digest
from tests.case import case

ROOT = Path(__file__).parents[3]
PACKAGE = "foldback.planner.kernels"


def test_lock_held_by_another_shows_its_fraction_and_waits_no_longer_than_its_bound(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(compiling_lock, "LOCK_POLL_S", 0.0)
    monkeypatch.setattr(compiling_lock, "MAX_LOCK_WAIT_S", 0.01)
    holder, other_compiling_lock = (
        CompilingLock(tmp_path / FIRST_LOCK),
        CompilingLock(tmp_path / FIRST_LOCK),
    )
    holder.acquire(lambda _: pytest.fail("nobody holds it"))
    holder.add(compiling_lock.FIRST_KERNELS_BYTES // 2)
    waits_s: list[float] = []
    other_compiling_lock.acquire(waits_s.append)
    ends = compiling_lock.IMPORTS_FRACTION, compiling_lock.MAX_COMPILED_FRACTION
    middle = pytest.approx(sum(ends) / 2.0, abs=1e-4)
    assert waits_s and waits_s == [middle] * len(waits_s)
    assert compiling_fraction(tmp_path) == middle
    holder.release()
    assert compiling_fraction(tmp_path) is None
    other_compiling_lock.release()


def test_garbage_collection_is_rare_while_kernels_are_compiled() -> None:
    before = gc.get_threshold()
    with Compiling():
        assert gc.get_threshold() == before
        njit(lambda: 0)()
        assert gc.get_threshold() == (GC_THRESHOLD_OBJECTS, *before[1:])
    assert gc.get_threshold() == before


def test_lock_file_is_for_its_user_alone_and_a_link_is_not_followed(tmp_path: Path) -> None:
    lock = CompilingLock(tmp_path / FIRST_LOCK)
    lock.acquire(lambda _: None)
    lock.release()
    assert (tmp_path / FIRST_LOCK).stat().st_mode & 0o777 == 0o600
    (tmp_path / "elsewhere").write_text("whole")
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    linked = CompilingLock(tmp_path / "link")
    linked.acquire(lambda _: pytest.fail("nothing waits"))
    assert (tmp_path / "elsewhere").read_text() == "whole"


def test_inner_kernels_are_imported_by_kernels_only() -> None:
    called = [
        f"{path.relative_to(ROOT)}: {node.module}.{name.name}"
        for top in ("planner", "server", "web", "tests", "examples")
        for path in (ROOT / top).rglob("*.py")
        if path.parent != ROOT / "planner" / "kernels" and PACKAGE in (text := path.read_text())
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(f"{PACKAGE}.")
        for name in node.names
        if _is_inner(getattr(importlib.import_module(str(node.module)), name.name))
    ]
    assert not called


def _is_inner(value: object) -> bool:
    return isinstance(value, Dispatcher) and "no_cpython_wrapper" in value.targetoptions


TWO_CALLERS = """
from numba import njit
from foldback.planner.kernels import INNER, KERNEL

@njit(**INNER)
def inner(values, last):
    if last < 0:
        raise ValueError("below 0")
    total = 0.0
    for k in range(last):
        total += values[k]
    return total

@njit(**KERNEL)
def one(values, last):
    return inner(values, last)

@njit(**KERNEL)
def other(values, last):
    return 2.0 * inner(values, last)
"""


def _module(path: Path, name: str) -> ModuleType:
    module_spec = importlib.util.spec_from_file_location(name, path)
    assert module_spec is not None and module_spec.loader is not None
    module = importlib.util.module_from_spec(module_spec)
    module_spec.loader.exec_module(module)
    return module


def test_inner_kernel_has_no_machine_code_and_serves_a_second_caller_from_the_cache(
    tmp_path: Path,
) -> None:
    path = tmp_path / "two_callers.py"
    path.write_text(TWO_CALLERS)
    values = np.arange(4.0)
    compiled = _module(path, "two_callers")
    assert compiled.one(values, 4) == 6.0
    (result,) = compiled.inner.overloads.values()
    assert isinstance(result.library, InnerLibrary)
    machine_code = result.library._get_compiled_object()  # pyright: ignore[reportPrivateUsage]
    assert result.fndesc.llvm_func_name.encode() not in machine_code
    loaded = _module(path, "two_callers")
    assert loaded.one(values, 4) == 6.0
    assert loaded.other(values, 4) == 12.0
    assert len(loaded.inner.stats.cache_hits) == 1
    with pytest.raises(ValueError, match="below 0"):
        loaded.other(values, -1)


FILES = sorted(path for path in KERNELS.glob("*.py") if path.name != "__init__.py")


def imports_of(path: Path) -> set[Path]:
    """Return the files of kernels that a file imports, by its syntax tree."""
    return {
        KERNELS / f"{node.module.rpartition('.')[2]}.py"
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom)
        and node.module is not None
        and node.module.startswith("foldback.planner.kernels.")
    }


def test_sources_of_a_kernel_hold_all_its_imports() -> None:
    for path in FILES:
        with case(path.stem):
            assert path in sources(path)
            for source in sources(path):
                assert imports_of(source) <= set(sources(path))
                # Definitions of other packages would not be compared.
                modules = [
                    node.module or ""
                    for node in ast.parse(source.read_text()).body
                    if isinstance(node, ast.ImportFrom)
                ]
                assert all(
                    not m.startswith("foldback") or m.startswith("foldback.planner.kernels")
                    for m in modules
                )


def test_digest_changes_with_a_file_that_is_imported_by_an_imported_one(tmp_path: Path) -> None:
    for path in FILES:
        shutil.copy(path, tmp_path)
    sweep, kinematics = tmp_path / "sweep.py", tmp_path / "kinematics.py"
    assert kinematics in sources(sweep) and kinematics not in imports_of(KERNELS / "sweep.py")
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
            module = importlib.import_module(f"foldback.planner.kernels.{path.stem}")
            for kernel in vars(module).values():
                if isinstance(kernel, Dispatcher) and kernel.py_func.__module__ == module.__name__:
                    cache: Any = vars(kernel)["_cache"]
                    file = cache._cache_file
                    assert file._source_stamp == sources_digest(path)
                    assert sources_digest(path) in file._version


def test_outdated_index_with_a_removed_type_is_not_read(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    removed_class = type("Gone", (), {"__module__": kernel_cache.__name__})
    monkeypatch.setattr(kernel_cache, "Gone", removed_class, raising=False)
    IndexDataCacheFile(str(tmp_path), "kernel", "old")._save_index({removed_class: "kernel.1.nbc"})
    monkeypatch.undo()
    assert IndexDataCacheFile(str(tmp_path), "kernel", "new").load("key") is None
    with pytest.raises(AttributeError):
        IndexDataCacheFile(str(tmp_path), "kernel", "old").load("key")
