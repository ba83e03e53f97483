"""Copy of the checkout in which one fault after the other is made."""

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

from foldback.planner.core import _core
from tests.faults.fault import Fault

CORE: Final = Path("foldback/planner/core")
CORE_SOURCES: Final = (".cpp", ".hpp")
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

    The compiled core is that of the checkout until a fault changes one of its sources; then it is
    built anew for the tests of this fault.

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
        for path in tracked:
            if path.is_file() or path.is_symlink():  # tracked files may be deleted
                copy = work_dir / path.relative_to(checkout)
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(path, copy, follow_symlinks=False)
        self._python = _interpreter(work_dir)
        self._core = work_dir / CORE.relative_to("foldback") / Path(_core.__file__).name
        shutil.copy2(_core.__file__, self._core)

    @contextmanager
    def with_fault(self, fault: Fault) -> Iterator[None]:
        """Make a fault in the copy for the duration of the context.

        Raises:
            StaleFaultError: If the file does not hold the old text exactly once.
        """
        path = self._root / fault.file
        before, times = path.read_text(encoding="utf-8"), path.stat()
        path.write_text(fault.apply(before), encoding="utf-8")
        try:
            if path.suffix in CORE_SOURCES:
                self._build_core()
            yield
        finally:
            path.write_text(before, encoding="utf-8")
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
            shutil.copy2(_core.__file__, self._core)

    def run_tests(self, arguments: Sequence[str], *, seconds: float) -> Run:
        """Run tests until the first one fails.

        Args:
            arguments: Arguments for pytest.
            seconds: Time limit, s.
        """
        (self._root / LAST_FAILED).unlink(missing_ok=True)
        process = subprocess.Popen(
            [self._python, "-m", "pytest", "-q", "-x", "--tb=short", *arguments],
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

    def _build_core(self) -> None:
        """Build the compiled core from the copy's sources, as far as they have changed."""
        place = self._root / "core"
        build = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--upgrade"]
        subprocess.run([*build, "--target", str(place), str(self._root)], check=True)
        shutil.copy2(place / CORE / self._core.name, self._core)


def _interpreter(root: Path) -> Path:
    """Return a Python that imports from the copy, and all else from where this one does.

    Processes that tests start use the same Python, regardless of their environment variables.
    """
    home = root / ".venv"
    venv.create(home)
    path = sysconfig.get_path("purelib", "venv", vars={"base": str(home)})
    installed = sysconfig.get_path("purelib")
    # Not as a site directory: its link to the checkout would come first.
    (Path(path) / "copy.pth").write_text(f"{root}\n{installed}\n")
    return home / "bin" / "python"
