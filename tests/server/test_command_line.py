"""The command line: what it offers, and that it starts without what it does not need."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from server.command_line import COMMANDS

COMMANDS_DIR = Path(__file__).parents[2] / "server" / "commands"


def foldback(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-P", "-m", "server.command_line", *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def test_every_command_is_offered() -> None:
    files = {path.stem for path in COMMANDS_DIR.glob("*.py")} - {"__init__"}
    assert set(COMMANDS) == files
    listed = foldback("--help")
    assert listed.returncode == 0
    for command in COMMANDS:
        assert f" {command} " in listed.stdout


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(command: str) -> None:
    answer = foldback(command, "--help")
    assert answer.returncode == 0, answer.stderr
    assert f"foldback {command}" in answer.stdout


def test_an_unknown_command_is_an_error() -> None:
    answer = foldback("unfold")
    assert answer.returncode == 2
    assert "unfold" in answer.stderr


@pytest.mark.parametrize("command", ["serve", "worker"])
def test_heavy_packages_are_not_imported_before_they_are_needed(command: str) -> None:
    """The supervisor starts its workers before the web process imports viser and the like."""
    code = (
        "import sys; from server.command_line import application; "
        f"application([{command!r}]); "
        "sys.exit(' '.join({'viser', 'mujoco', 'numba', 'fastapi', 'dbos'} & set(sys.modules)))"
    )
    answer = subprocess.run(
        [sys.executable, "-P", "-c", code], capture_output=True, text=True, check=False
    )
    assert not answer.stderr.strip()


def test_the_web_process_leaves_the_physics_to_others() -> None:
    code = (
        "import sys; import server.app; "
        "sys.exit(' '.join({'mujoco', 'ortools', 'planner.stages'} & set(sys.modules)))"
    )
    answer = subprocess.run(
        [sys.executable, "-P", "-c", code], capture_output=True, text=True, check=False
    )
    assert not answer.stderr.strip()


def test_a_port_that_is_taken_is_a_clear_failure(tmp_path: Path) -> None:
    import socket

    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        answer = foldback("serve", "--port", port, "--data-dir", str(tmp_path), "--workers", "0")
    assert answer.returncode == 1
    assert "in use" in answer.stderr
