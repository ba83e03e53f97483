"""The command line: what it offers, and that it starts without what it does not need."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from pathlib import Path
from unittest.mock import MagicMock

import pytest
from numba import njit
from typer.testing import CliRunner

from cli import fold
from planner.pipeline import stages
from planner.readers.gallery import Gallery
from server.cli.command_line import COMMANDS, application

ROOT = Path(__file__).parents[3]
COMMAND_DIRS = (ROOT / "cli", ROOT / "server" / "cli")
SHARED = {"__init__", "command_line", "inputs", "options"}


def foldback(*arguments: str) -> subprocess.CompletedProcess[str]:
    """What a command says and ends with, run in this process: it need not import anything."""
    done = CliRunner().invoke(application(), arguments, prog_name="foldback")
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return subprocess.CompletedProcess(arguments, done.exit_code, done.stdout, done.stderr)


def test_every_command_is_offered() -> None:
    files = {path.stem for folder in COMMAND_DIRS for path in folder.glob("*.py")} - SHARED
    assert set(COMMANDS) == {*files, "admin"}  # a folder of its own: server/operate
    listed = foldback("--help")
    assert listed.returncode == 0
    for command in COMMANDS:
        assert f" {command} " in listed.stdout


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(command: str) -> None:
    answer = CliRunner().invoke(application(), [command, "--help"], prog_name="foldback")
    assert answer.exit_code == 0, answer.output
    assert f"foldback {command}" in answer.stdout
    assert COMMANDS[command].rstrip(".") in " ".join(answer.stdout.split())


def test_cells_in_no_order_are_told_and_read_as_voxels_when_asked(tmp_path: Path) -> None:
    cells = [[x, y, z] for x in range(3) for y in range(2) for z in range(2)]
    cells[1], cells[6] = cells[6], cells[1]
    file = tmp_path / "cells.json"
    file.write_text(json.dumps(cells))
    out = str(tmp_path / "path.json")
    told = foldback("shape", str(file), "--out", out, "--json")
    assert told.returncode == 0, told.stderr
    note = "Read as voxels, because cells 0 and 1 are not neighbours."
    assert json.loads(told.stdout.splitlines()[-1])["notes"][0] == note
    asked = foldback("shape", str(file), "--out", out, "--as-voxels", "--json")
    assert asked.returncode == 0, asked.stderr
    assert note not in json.loads(asked.stdout.splitlines()[-1])["notes"]
    refused = foldback("fold", str(file), "--out", str(tmp_path / "fold"))
    assert refused.returncode == 2
    assert "cells 0 and 1" in refused.stderr
    assert "--as-voxels" in refused.stderr


def test_that_it_compiles_is_told_while_it_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def compiling(*_: object, **__: object) -> dict[str, object]:
        njit(lambda: 0)()
        return {}

    monkeypatch.setattr(stages, "run_stage", compiling)
    monkeypatch.setattr(stages, "next_stage", MagicMock(return_value=None))
    assert fold.compute(tmp_path, 1) == {}
    assert "compiling(once on each machine)" in capsys.readouterr().err


def test_a_name_that_is_none_gets_the_nearest_ones(tmp_path: Path) -> None:
    answer = foldback("fold", "wrench-161", "--out", str(tmp_path / "fold"))
    assert answer.returncode == 2
    assert "wrench-160" in answer.stderr
    assert "mallet" not in answer.stderr
    assert f"{len(Gallery().shapes())} examples" in answer.stderr
    assert len(answer.stderr) < 300


def test_a_folder_that_is_not_there_is_told_so(tmp_path: Path) -> None:
    answer = foldback("verify", str(tmp_path / "nowhere"))
    assert answer.returncode == 2
    assert "Folder not found" in answer.stderr
    file = tmp_path / "file"
    file.touch()
    assert "This is not a folder" in foldback("verify", str(file)).stderr


def test_an_unknown_command_is_an_error() -> None:
    answer = foldback("unfold")
    assert answer.returncode == 2
    assert "unfold" in answer.stderr


def imported(*arguments: str) -> set[str]:
    """The packages and modules that a run of ``foldback`` imports; it must end with 0."""
    answer = subprocess.run(
        [sys.executable, "-P", "-X", "importtime", "-m", "server.cli.command_line", *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    assert answer.returncode == 0, answer.stderr[-2000:]
    lines = [line for line in answer.stderr.splitlines() if line.startswith("import time:")]
    names = {line.rpartition("|")[2].strip() for line in lines}
    return names | {name.partition(".")[0] for name in names}


WEB = {"fastapi", "sqlalchemy", "uvicorn", "viser"}
PHYSICS = {"mujoco", "numba", "numpy", "scipy", "zarr"}


@pytest.mark.processes
@pytest.mark.parametrize("asked", [["--help"], ["--version"]])
def test_what_all_commands_are_for_is_told_without_importing_any(asked: list[str]) -> None:
    assert not imported(*asked) & {*WEB, *PHYSICS, "planner", "pydantic"}


@pytest.mark.processes
@pytest.mark.parametrize("command", ["serve", "worker"])
def test_heavy_packages_are_not_imported_before_they_are_needed(command: str) -> None:
    """The supervisor starts its workers before the web process imports viser and the like."""
    assert not imported(command, "--help") & {*WEB, *PHYSICS}


@pytest.mark.processes
def test_a_path_is_folded_without_what_other_inputs_need(tmp_path: Path) -> None:
    path = tmp_path / "path.json"
    path.write_text(json.dumps([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]))
    found = imported("fold", str(path), "--out", str(tmp_path / "fold"))
    assert found >= PHYSICS
    # Web servers, what searches for paths, what opens windows, what reads meshes and fills cells.
    assert not found & {*WEB, "web", "pysat", "trimesh", "glfw", "PIL", "mcap"}
    assert not found & {
        f"planner.{name}"
        for name in (
            "shapes.voxelise",
            "pathfinding.filling",
            "pathfinding.shape_overlap",
            "shapes.decimation",
        )
    }


COMPUTING = {"llvmlite", "mujoco", "numba", "pysat", "scipy", "zarr", "planner.pipeline.stages"}
SHOWING = {"PIL", "trimesh", "viser"}


@pytest.mark.processes
@pytest.mark.parametrize(
    "processes",
    [
        {
            "server.jobs.worker": {*COMPUTING, *SHOWING, "fastapi"},
            "server.app": {*COMPUTING, *SHOWING},
        },
        {
            "server.processes.read_task": {*COMPUTING, *WEB, *SHOWING},
            "planner.pipeline.stages": {
                *("mujoco", "scipy.interpolate", "scipy.sparse", "zarr", *WEB, *SHOWING),
            },
            "server.processes.retime_task": {"mujoco", "scipy.interpolate", "zarr", *WEB, *SHOWING},
            "web.movies.make_movie": {"mujoco", "zarr", *WEB, *SHOWING},
        },
    ],
    ids=["serving", "computing"],
)
def test_each_process_starts_without_what_others_compute_with(
    processes: dict[str, set[str]],
) -> None:
    """A service starts several, and users wait for it: see docs/decisions/0021-compiling.md.

    Here one process imports what each begins with, in turn: the later ones bring no less by it.
    """
    code = "".join(f"import sys, {process}; print(*sys.modules)\n" for process in processes)
    answer = subprocess.run(
        [sys.executable, "-P", "-c", code], capture_output=True, text=True, check=False
    )
    assert answer.returncode == 0, answer.stderr[-2000:]
    said = answer.stdout.splitlines()
    assert len(said) == len(processes)
    for (process, without), words in zip(processes.items(), said, strict=True):
        found = set(words.split())
        assert process in found
        assert not found & without, process


def test_the_first_shape_is_passed_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("keep_secrets", "set_up_logs", "signal"):  # of the process: the tests are in it
        monkeypatch.setattr(f"server.cli.serve.{name}", MagicMock())
    run = MagicMock()
    monkeypatch.setattr("server.cli.serve._run", run)
    place = ("--data-dir", str(tmp_path))
    assert foldback("serve", "--workers", "0", "--first-shape", "cross", *place).returncode == 0
    ((settings, shape), _) = run.call_args
    assert (settings.data_dir, shape) == (tmp_path, "cross")


def test_a_port_that_is_taken_is_a_clear_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    # What it changes of its process, which is that of the tests.
    for name in ("keep_secrets", "set_up_logs", "_allow_files", "signal", "sys"):
        monkeypatch.setattr(f"server.cli.serve.{name}", MagicMock())
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        place = ("--data-dir", str(tmp_path))
        answer = foldback("serve", "--workers", "0", "--port", port, *place)
    assert answer.returncode == 1
    assert "in use" in caplog.text
