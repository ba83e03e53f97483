"""Commands on a machine without a home, disk space, UTF-8 or an open output."""

import json
import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import mujoco
import pytest

from foldback.server.cli.command_line import is_memory_error
from tests.case import case
from tests.run_python import ROOT

NOWHERE = "/dev/null/home"
"""Path below which nothing can be created, not even by root."""
ONE_KERNEL = """
from foldback.planner.kernels.trails import one_circuit
print(one_circuit.stats.cache_path)
"""
SHELL = '{limits} exec "$0" -P -m foldback.server.cli.command_line "$@" {streams}'


def run(
    *arguments: str | Path, limits: str = "", streams: str = "", **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run a command in a shell that sets limits and redirects its streams."""
    return subprocess.run(
        ["sh", "-c", SHELL.format(limits=limits, streams=streams), sys.executable, *arguments],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )


@pytest.fixture
def foreign_planner(tmp_path: Path) -> Path:
    """Copy of the planner beside whose kernels nothing can be stored."""
    program = tmp_path / "program"
    shutil.copytree(
        ROOT / "planner",
        program / "foldback" / "planner",
        ignore=shutil.ignore_patterns("__pycache__"),
    )
    shutil.copy(ROOT / "foldback" / "__init__.py", program / "foldback")
    (program / "foldback/planner/kernels/__pycache__").touch()  # a file instead of the directory
    return program


def test_kernels_without_a_home_are_stored_in_a_private_temporary_directory(
    foreign_planner: Path, tmp_path: Path
) -> None:
    def cache_path(temporary: Path) -> str:
        temporary.mkdir(exist_ok=True)
        unset = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "PYTHONPATH")}
        homeless = {"HOME": NOWHERE, "XDG_CACHE_HOME": NOWHERE, "TMPDIR": str(temporary)}
        done = subprocess.run(
            [sys.executable, "-c", ONE_KERNEL],
            cwd=foreign_planner,
            env={**unset, **homeless},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    private = tmp_path / "private"
    assert cache_path(private).startswith(str(private))
    (created,) = private.iterdir()
    assert stat.S_IMODE(created.stat().st_mode) == 0o700
    for name in ("mode", "link"):
        with case(name):
            shared = tmp_path / name
            shared.mkdir()
            planted = shared / created.name
            if name == "link":
                planted.symlink_to(private)
            else:
                planted.mkdir()
                planted.chmod(0o777)
            assert cache_path(shared) == "None"  # compiled, and not stored


def test_letters_that_the_output_lacks_are_replaced() -> None:
    for encoding in ("ascii", "cp1252", "cp932", "latin-1"):
        with case(encoding):
            done = run("settings", PYTHONUTF8="0", PYTHONIOENCODING=encoding)
            assert done.returncode == 0, done.stderr
            assert done.stderr == ""


def test_closed_streams_discard_output() -> None:
    for streams in (">&-", "2>&-", ">&- 2>&-", "<&- >&- 2>&-"):
        with case(streams):
            done = run("settings", streams=streams)
            assert done.returncode == 0, done.stderr
            assert done.stderr == ""


def test_full_disk_ends_a_fold_with_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "path.json"
    path.write_text(json.dumps([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 1, 1], [1, 1, 1]]))
    # Python stores truncated bytecode where a file may not grow.
    done = run(
        *("fold", path, "--out", tmp_path / "fold", "--json"),
        limits="ulimit -f 8;",
        PYTHONDONTWRITEBYTECODE="1",
    )
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    error = json.loads(done.stdout.splitlines()[-1])["error"]
    assert error["code"] == "disk-full"
    assert "free some space" in error["detail"]


def test_answer_that_a_full_disk_cannot_take_ends_with_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "path.json"
    path.write_text(json.dumps([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]))
    for arguments in (["--help"], ["settings"], ["shape", path, "--out", tmp_path / "o", "--json"]):
        with case(arguments[0]):
            done = run(*arguments, streams="> /dev/full")
            assert done.returncode == 2, done.stderr
            assert done.stderr.count("\n") == 1, done.stderr
            assert "No space left on device" in done.stderr


def test_limit_of_memory_ends_a_fold_with_one_sentence(tmp_path: Path) -> None:
    done = run("fold", "wrench-160", "--out", tmp_path / "fold", limits="ulimit -v 1500000;")
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert done.stderr.splitlines()[-1].startswith("this machine has too little free memory")


def test_used_up_memory_is_recognised_in_errors_of_mujoco() -> None:
    with pytest.raises(ValueError) as caught:
        mujoco.MjModel.from_xml_string('<mujoco><size memory="100P"/></mujoco>')
    assert is_memory_error(caught.value)
    assert is_memory_error(MemoryError())
    assert not is_memory_error(ValueError("expected 8 modules"))
