"""Commands on a machine without a home, disk space, UTF-8 or an open output."""

import json
import os
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
    # With a little more, it may be glibc that finds no memory for a thread, and aborts.
    done = run("fold", "wrench-160", "--out", tmp_path / "fold", limits="ulimit -v 400000;")
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert done.stderr.splitlines()[-1].startswith("this machine has too little free memory")


def test_used_up_memory_is_recognised_in_errors_of_mujoco() -> None:
    with pytest.raises(ValueError) as caught:
        mujoco.MjModel.from_xml_string('<mujoco><size memory="100P"/></mujoco>')
    assert is_memory_error(caught.value)
    assert is_memory_error(MemoryError())
    assert not is_memory_error(ValueError("expected 8 modules"))
