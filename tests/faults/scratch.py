"""Copy of the checkout in which one fault after the other is made."""

import json
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.faults.fault import Fault

KERNEL_CACHES: Final = ("*.nbi", "*.nbc")
WARM_UP: Final = "from foldback.planner.pipeline.warm_up import warm_up; warm_up()"
LAST_FAILED: Final = Path(".pytest_cache/v/cache/lastfailed")
PASSED: Final = 0
FAILED_TESTS: Final = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """Result of a run of tests.

    Attributes:
        code: Exit status of pytest; None if it did not end in time.
        failed: Tests that failed.
        output: Output of pytest.
    """

    code: int | None
    failed: tuple[str, ...]
    output: str


class Scratch:
    """Copy of a checkout's current files in a folder of its own.

    The files have their original times, so that kernels which numba has compiled in the checkout
    need not be compiled again; missing ones are compiled once, before the first fault. Kernels that
    call a changed one, in other files too, are compiled again when a test needs them, as their
    calls are unknown.

    Args:
        checkout: Root of a git checkout.
        place: Empty folder.
    """

    def __init__(self, checkout: Path, work_dir: Path) -> None:
        self._root = work_dir
        listed = subprocess.run(
            ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
            cwd=checkout,
            capture_output=True,
            text=True,
            check=True,
        )
        tracked = [checkout / name for name in listed.stdout.split("\0") if name]
        for path in (*tracked, *self._compiled(tracked)):
            if path.is_file() or path.is_symlink():  # tracked files may be deleted
                copy = work_dir / path.relative_to(checkout)
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(path, copy, follow_symlinks=False)
        self._python = _interpreter(work_dir)
        subprocess.run([self._python, "-c", WARM_UP], cwd=work_dir, check=True)

    @contextmanager
    def with_fault(self, fault: Fault) -> Iterator[None]:
        """Make a fault in the copy for the duration of the context.

        Raises:
            StaleFaultError: If the file does not hold the old text exactly once.
        """
        path = self._root / fault.file
        before, times = path.read_text(encoding="utf-8"), path.stat()
        cache_dir = self._root / ".compiled"
        moved: dict[Path, Path] = {}
        stale = self._callers(fault.file)
        path.write_text(fault.apply(before), encoding="utf-8")
        cache_dir.mkdir()
        for cache in self._compiled(stale):
            moved[cache] = cache.rename(cache_dir / f"{len(moved)}")
        try:
            yield
        finally:
            path.write_text(before, encoding="utf-8")
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
            for cache in self._compiled(stale):
                cache.unlink()
            for cache, cache_directory in moved.items():
                cache_directory.rename(cache)
            shutil.rmtree(cache_dir)

    def run_tests(self, arguments: Sequence[str], *, seconds: float) -> Run:
        """Run tests until the first one fails.

        Args:
            arguments: Arguments for pytest.
            seconds: Time limit, s.
        """
        (self._root / LAST_FAILED).unlink(missing_ok=True)
        process = subprocess.Popen(
            # Compiling all kernels that call a changed one takes a minute; a test needs few of
            # them.
            [self._python, "-m", "pytest", "-q", "-x", "--tb=short", "--no-compile", *arguments],
            cwd=self._root,
            # Programs beside this Python are found by their names.
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
        failed = self._root / LAST_FAILED
        names: tuple[str, ...] = tuple(json.loads(failed.read_bytes())) if failed.exists() else ()
        return Run(code=code, failed=names, output=output)

    def _callers(self, file: str) -> set[Path]:
        """Return a file and those that import it, directly or not, if they hold kernels."""
        kernels = {
            path: text
            for path in self._root.rglob("*.py")
            if "njit" in (text := path.read_text(encoding="utf-8"))
        }
        paths: set[Path] = set()
        waiting = [self._root / file]
        while waiting:
            path = waiting.pop()
            if path in paths or path not in kernels:
                continue
            paths.add(path)
            module = ".".join(path.relative_to(self._root).with_suffix("").parts)
            waiting += [
                second for second, text in kernels.items() if f"from foldback.{module} " in text
            ]
        return paths

    def _compiled(self, files: Iterable[Path]) -> list[Path]:
        """Return the cache files of the kernels in some files."""
        return [
            cache
            for file in files
            for kind in KERNEL_CACHES
            for cache in (file.parent / "__pycache__").glob(f"{file.stem}.{kind}")
        ]


def _interpreter(root: Path) -> Path:
    """Return a Python that imports from the copy, and all else from where this one does.

    Processes that tests start use the same Python, regardless of their environment variables.
    """
    home = root / ".venv"
    venv.create(home)
    path = sysconfig.get_path("purelib", "venv", vars={"base": str(home)})
    installed = sysconfig.get_path("purelib")
    (Path(path) / "copy.pth").write_text(f"{root}\nimport site; site.addsitedir({installed!r})\n")
    return home / "bin" / "python"
