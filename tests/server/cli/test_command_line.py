"""Command line: its commands, and a start without unneeded imports."""

import json
import socket
import subprocess
from importlib.metadata import version
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import pytest
from typer.testing import CliRunner

from foldback.cli.summary import show
from foldback.planner.readers.gallery import Gallery
from foldback.server.cli.command_line import COMMANDS, application
from tests.run_python import ROOT, run_python

COMMAND_FILES = (*ROOT.glob("cli/*.py"), *ROOT.glob("server/cli/*.py"))


def foldback(*arguments: object, **environment: str) -> subprocess.CompletedProcess[str]:
    """Return the output and exit status of a command, run in this process to save its imports."""
    words = [str(argument) for argument in arguments]
    done = CliRunner().invoke(application(), words, prog_name="foldback", env=environment)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return subprocess.CompletedProcess(arguments, done.exit_code, done.stdout, done.stderr)


def foldback_json(*arguments: object, status: int = 0) -> Any:
    """Return the value that a command with an exit status writes as JSON."""
    done = foldback(*arguments, "--json")
    assert done.returncode == status, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_every_command_is_offered() -> None:
    """The help texts are stored and compared by tests/server/contract."""
    named = {path.stem for path in COMMAND_FILES if f"\ndef {path.stem}(" in path.read_text()}
    assert set(COMMANDS) == named | {"admin"}  # ``admin`` is a group of commands
    assert foldback("--version").stdout.strip() == f"foldback {version('foldback')}"


def test_unordered_cells_are_read_as_voxels_on_request(tmp_path: Path) -> None:
    cells = [[x, y, z] for x in range(3) for y in range(2) for z in range(2)]
    cells[1], cells[6] = cells[6], cells[1]
    file, out = tmp_path / "cells.json", str(tmp_path / "path.json")
    file.write_text(json.dumps(cells))
    note = (
        "The cells were read as a shape, not as a path, because some cells that follow each other "
        "are not neighbours."
    )
    for options in ((), ("--as-voxels",)):
        report = foldback_json("shape", file, "--out", out, *options)
        assert (note in report["notes"]) == (not options)
    refused = foldback("fold", str(file), "--out", str(tmp_path / "fold"))
    assert refused.returncode == 2
    assert "cells 1 and 2" in refused.stderr and "option as_voxels" in refused.stderr


def test_terminal_counts_modules_and_frames_from_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    overlap = {"motion": "plan", "modules": [82, 112], "depth": 1.16, "module_size": 0.95}
    reason = {"code": "overlap", "values": {**overlap, "progress": 0.66, "frame": 13.5}}
    turn = {"hinge": 4, "module": 4, "turned_rad": 0.1, "modules": [4, 9], "overlap": 0.1}
    blocks = {"kind": "blocks", "module_size": 0.95, "bent_above_rad": 0.1, "first_hinge": 0}
    evidence = {**blocks, "turns": [turn], "unit": None, "moves": []}
    summary = {
        "status": "failed",
        "certificate": {"verified": False, "reason": reason},
        "explosion": {"frames": 100, "steps": 0},
        "stuck": {"kind": "joints", "modules": [4], "words": "", "evidence": evidence},
        **{"playback": None, "refold": None, "smoothing": None},
        **{"modules": 160, "module": "cube"},
    }
    show(summary, tmp_path)
    verdict, stuck, *_ = capsys.readouterr().out.splitlines()
    assert verdict == (
        "failed: in the plan, modules 83 and 113 overlap by 1.16 times the spacing at module size "
        "0.95, 66 % through the motion (frame 115)"
    )
    assert stuck == (
        "The hinge at module 5 cannot straighten, because modules would overlap: modules 5 and 10 "
        "(at a module size of 0.95)."
    )


def test_unknown_shape_is_refused_with_similar_names(tmp_path: Path) -> None:
    answer = foldback("fold", "wrench-161", "--out", str(tmp_path / "fold"))
    assert answer.returncode == 2
    assert "wrench-160" in answer.stderr and "mallet" not in answer.stderr
    assert f"{len(Gallery().shapes())} examples" in answer.stderr
    assert len(answer.stderr) < 300


WEB = {"fastapi", "sqlalchemy", "uvicorn", "viser"}
PHYSICS = {"mujoco", "numpy", "scipy"}
COMPUTING = {
    "mujoco",
    "pysat",
    "scipy",
    "foldback.planner.pipeline.stages",
}
SHOWING = {"PIL", "trimesh", "viser"}
STEPS = """
import os, sys
from foldback.server.cli import command_line

def run(*arguments):
    os.environ.setdefault("MUJOCO_GL", "off")  # as the command does it
    try:
        command_line.application()(arguments)
    except SystemExit as end:
        assert not end.code
"""
OTHER_INPUTS = {"pysat", "glfw", "mcap", "foldback.planner.pathfinding.filling_methods"}
OTHER_INPUTS |= {"foldback.planner.pathfinding.shape_overlap", "foldback.planner.shapes.voxelise"}


@pytest.mark.processes
@pytest.mark.parametrize(
    "steps",
    [
        {
            # The supervisor starts its workers first.
            "run('--help')": {*WEB, *PHYSICS, "foldback.planner", "pydantic"},
            "run('serve', '--help')": {*WEB, *PHYSICS},
            "run('worker', '--help')": {*WEB, *PHYSICS},
            "import foldback.server.jobs.worker": {*COMPUTING, *SHOWING, "fastapi"},
            "import foldback.server.app": {*COMPUTING, *SHOWING},
        },
        {
            "import foldback.server.processes.read_task": {*COMPUTING, *WEB, *SHOWING},
            "import foldback.planner.pipeline.stages": {
                *("mujoco", "scipy.interpolate", "scipy.ndimage", "scipy.sparse"),
                *(*WEB, *SHOWING),
            },
            "import foldback.server.processes.retime_task": {
                *("mujoco", "scipy.interpolate", *WEB, *SHOWING),
            },
            "import foldback.web.movies.make_movie": {"mujoco", *WEB, *SHOWING},
            # No web server, no search for paths, no windows, no readers of meshes.
            "run('fold', 'path.json', '--out', 'fold')": {*WEB, *SHOWING, *OTHER_INPUTS},
        },
    ],
    ids=["serving", "computing"],
)
def test_each_process_starts_without_packages_of_others(
    steps: dict[str, set[str]], tmp_path: Path
) -> None:
    """A service starts several processes, and users wait for it: decision 0022.

    Here one process runs the start of each in turn; earlier starts can only add to the imports of
    later ones.
    """
    (tmp_path / "path.json").write_text(json.dumps([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]))
    code = STEPS + "".join(f"{step}; print('=', *sys.modules)\n" for step in steps)
    code += "from foldback.planner.chain.built_in_modules import _module\n"
    code += "print('shipped modules:', _module.cache_info().currsize)\n"
    output = run_python("-P", "-c", code, cwd=tmp_path)
    sizes = [line for line in output.splitlines() if line.startswith("= ")]
    for (step, without), words in zip(steps.items(), sizes, strict=True):
        assert not set(words.split()) & without, step
    assert (tmp_path / "fold" / "plan.npz").exists() == any("fold'" in step for step in steps)
    assert "shipped modules: 2\n" in output, "cubes and tetrahedra alone are built at once"


@pytest.mark.usefixtures("process_state")
def test_first_shape_is_passed_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = MagicMock()
    monkeypatch.setattr("foldback.server.cli.serve._run", run)
    place = ("--data-dir", str(tmp_path))
    assert foldback("serve", "--workers", "0", "--first-shape", "cross", *place).returncode == 0
    ((settings, shape), _) = run.call_args
    assert (settings.data_dir, shape) == (tmp_path, "cross")


@pytest.mark.usefixtures("process_state")
def test_taken_port_is_a_clear_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("foldback.server.cli.serve.sys", MagicMock())
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = str(server.getsockname()[1])
        place = ("--data-dir", str(tmp_path))
        answer = foldback("serve", "--workers", "0", "--port", port, *place)
    assert (answer.returncode, "in use" in caplog.text) == (1, True)
