"""Scratch: a copy of the checkout in which one fault after the other is made."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.faults.fault import Fault

KERNEL_CACHES: Final = ("*.nbi", "*.nbc")
WARM_UP: Final = "from planner.pipeline.warm_up import warm_up; warm_up()"
FAILED: Final = Path(".pytest_cache/v/cache/lastfailed")
GREEN: Final = 0
RED: Final = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """How a run of tests ended.

    Attributes:
        code: What pytest exited with; None when it had not ended in time.
        failed: The tests that failed.
        output: What it printed.
    """

    code: int | None
    failed: tuple[str, ...]
    output: str


class Scratch:
    """Files of a checkout, as they are now, in a folder of their own.

    Files keep their times, so that kernels which numba has compiled in the checkout need not be
    compiled again; what is not compiled yet is compiled once, before the first fault. It does not
    know which kernels call which: those that call a changed one, in other files too, are compiled
    anew when a test needs them.

    Args:
        checkout: The root of a git checkout.
        place: An empty folder.
    """

    def __init__(self, checkout: Path, place: Path) -> None:
        self._root = place
        listed = subprocess.run(
            ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
            cwd=checkout,
            capture_output=True,
            text=True,
            check=True,
        )
        tracked = [checkout / name for name in listed.stdout.split("\0") if name]
        folders = {path.parent for path in tracked}
        caches = [
            kernel
            for folder in folders
            for kind in KERNEL_CACHES
            for kernel in (folder / "__pycache__").glob(kind)
        ]
        for path in (*tracked, *caches):
            if path.is_file():  # and not deleted since it was committed
                copy = place / path.relative_to(checkout)
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(path, copy)
        self._python = _interpreter(place)
        subprocess.run([self._python, "-c", WARM_UP], cwd=place, check=True)

    @contextmanager
    def with_fault(self, fault: Fault) -> Iterator[None]:
        """Has a fault in the copy for as long as the context lasts.

        Raises:
            StaleFaultError: When the code is not there any more.
        """
        path = self._root / fault.file
        before, times = path.read_text(encoding="utf-8"), path.stat()
        aside = self._root / ".compiled"
        kept: dict[Path, Path] = {}
        stale = self._callers(fault.file)
        path.write_text(fault.applied(before), encoding="utf-8")
        aside.mkdir()
        for cache in self._compiled(stale):
            kept[cache] = cache.rename(aside / f"{len(kept)}")
        try:
            yield
        finally:
            path.write_text(before, encoding="utf-8")
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
            for cache in self._compiled(stale):
                cache.unlink()
            for cache, where in kept.items():
                where.rename(cache)
            shutil.rmtree(aside)

    def tested(self, arguments: Sequence[str], *, seconds: float) -> Run:
        """Runs tests until the first one fails.

        Args:
            arguments: For pytest.
            seconds: How long they may take.
        """
        (self._root / FAILED).unlink(missing_ok=True)
        process = subprocess.Popen(
            # All kernels that call a changed one take a minute; a test needs few of them.
            [self._python, "-m", "pytest", "-q", "-x", "--tb=short", "--no-compile", *arguments],
            cwd=self._root,
            # Programs that are installed beside this Python are found by their names.
            env={**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        code: int | None = None
        try:
            output, _ = process.communicate(timeout=seconds)
            code = process.returncode
        except subprocess.TimeoutExpired:
            output = ""
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        failed = self._root / FAILED
        names: tuple[str, ...] = tuple(json.loads(failed.read_bytes())) if failed.exists() else ()
        return Run(code=code, failed=names, output=output)

    def _callers(self, file: str) -> set[Path]:
        """A file and those that import it, directly or not, as far as they hold kernels."""
        kernels = {
            path: text
            for path in self._root.rglob("*.py")
            if "njit" in (text := path.read_text(encoding="utf-8"))
        }
        found: set[Path] = set()
        waiting = [self._root / file]
        while waiting:
            path = waiting.pop()
            if path in found or path not in kernels:
                continue
            found.add(path)
            module = ".".join(path.relative_to(self._root).with_suffix("").parts)
            waiting += [other for other, text in kernels.items() if f"from {module} " in text]
        return found

    def _compiled(self, files: set[Path]) -> list[Path]:
        """What is kept of the kernels in some files."""
        return [
            cache
            for file in files
            for kind in KERNEL_CACHES
            for cache in (file.parent / "__pycache__").glob(f"{file.stem}.{kind}")
        ]


def _interpreter(root: Path) -> Path:
    """A Python that imports from the copy, and all else from where this one does.

    Processes that tests start are of the same Python, whatever variables they are given.
    """
    home = root / ".venv"
    venv.create(home)
    own = sysconfig.get_path("purelib", "venv", vars={"base": str(home)})
    installed = sysconfig.get_path("purelib")
    (Path(own) / "copy.pth").write_text(f"{root}\nimport site; site.addsitedir({installed!r})\n")
    return home / "bin" / "python"
