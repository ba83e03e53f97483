"""``foldback sweep``: its rows, files, exit status and refusals."""

import json
import os
import pty
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from foldback.planner.sweeps.rows import Rows
from foldback.planner.sweeps.spec import SweepSpec
from foldback.planner.sweeps.sweep import SweepState
from tests.case import case
from tests.server.cli.test_command_line import foldback

REFUSALS = {
    "": "got no spec or two, expected SPEC, or options with --shape",
    "spec.toml --shape wrench-24 --out out": "got no spec or two",
    "nowhere.toml --out out": "'nowhere.toml', expected a spec in TOML, or the directory",
    "spec.toml": "got no directory, expected --out DIR",
    "bad.toml --out out": "got the unknown key 'seds', expected seeds",
    "broken.toml --out out": "got no TOML",
    "--shape wrench-25 --out out": "which no shape matches",
    "--shape wrench-24 --seeds x --out out": "got the seeds 'x', expected a number",
    "--shape wrench-24 --method peal --out out": "got the method 'peal', expected one of: auto",
    "spec.toml --out out --map row=shape": "got --map 'row', expected rows=",
    "spec.toml --out out --slurm partition": "got --slurm 'partition', expected KEY=VALUE",
    "map --map rows=shap": "'shap' for the map, expected shape",
    "spec.toml --out map": "seeds is 1 there and '0-9' here",
}
"""Commands, and words of the sentence that refuses each."""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Directory with specs, and with a sweep of one fold, which is done."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "spec.toml").write_text('shapes = "gallery:*-24"\nseeds = "0-9"\n')
    (tmp_path / "bad.toml").write_text('shapes = "gallery:*-24"\nseds = 1\n')
    (tmp_path / "broken.toml").write_text("shapes = [")
    spec = tmp_path / "map" / "sweep.toml"
    spec.parent.mkdir()
    spec.write_text('shapes = "gallery:wrench-24"\nseeds = 1\n')
    return tmp_path


def _with_row(place: Path, **values: str) -> None:
    spec = SweepSpec.from_toml(place / "map" / "sweep.toml")
    (fold,) = SweepState.of(spec, place / "map").missing()
    with Rows(place / "map").writing() as add:
        failed = {"verdict": "failed: it stalled", "reason": "stalled"}
        add({"key": fold.key, **fold.columns, **failed, **values})


def _drain(screen: int) -> None:
    """Read what a program writes to a terminal, so that it does not wait."""
    while os.read(screen, 4096):
        pass


def test_bad_commands_are_refused_in_a_sentence(place: Path) -> None:
    _with_row(place)
    for command, words in REFUSALS.items():
        with case(command):
            done = foldback("sweep", *command.split())
            assert done.returncode == 2, done.stdout
            assert words in done.stderr.replace("\n", " ")
    assert not (place / "out" / "sweep.toml").exists()


def test_plan_and_status_compute_nothing(place: Path) -> None:
    _with_row(place)
    plan = foldback("sweep", "spec.toml", "--dry-run").stdout.splitlines()
    assert plan[0].startswith("20 of 20 folds, ")
    assert plan[1] == "shape=mallet-24 group= modules=24 method=auto seed=0"
    assert len(plan) == 11
    assert foldback("sweep", "map", "--status").stdout.split() == [
        *("folds", "verdict", "1", "failed:", "stalled", "0", "left"),
    ]
    assert not (place / "out").exists()


def test_map_of_a_directory_is_drawn_and_nothing_computed(place: Path) -> None:
    _with_row(place)
    (place / "map" / "sweep.toml").write_text('shapes = "gallery:*-24"\nseeds = "0-9"\n')
    done = foldback("sweep", "map", "--map", "rows=method,columns=shape,by=group")
    assert done.returncode == 0, done.stderr
    assert "1 folds computed, 0 verified, 19 left." in (place / "map" / "index.html").read_text()


def test_sweeps_that_a_site_cannot_show_are_refused(place: Path) -> None:
    (place / "map" / "index.html").touch()
    done = foldback("site", "www", "--sweeps", "map")
    assert done.returncode == 2
    assert "got no map.svg, expected the directory of a sweep" in done.stderr.replace("\n", " ")
    for name in ("map.svg", "results.csv", "results.parquet"):
        (place / "map" / name).touch()
    done = foldback("site", "www", "--sweeps", "map", "--sweeps", "map")
    assert done.returncode == 2
    assert "got two sweeps with the name 'map'" in done.stderr.replace("\n", " ")


def test_axes_of_a_map_stay(place: Path) -> None:
    _with_row(place)
    foldback("sweep", "map", "--map", "rows=method,columns=shape,by=group")
    page = (place / "map" / "index.html").read_bytes()
    assert foldback("sweep", "map").returncode == 0
    assert (place / "map" / "index.html").read_bytes() == page
    assert foldback("sweep", "map", "--map", "rows=shap").returncode == 2
    assert foldback("sweep", "map").returncode == 0


def test_lost_folds_stay_in_the_exit_status(place: Path) -> None:
    _with_row(place, verdict="lost")
    for _ in range(2):
        assert foldback("sweep", "map").returncode == 3


def test_sweep_that_is_done_imports_no_engine(place: Path) -> None:
    _with_row(place)
    foldback("sweep", "map")  # writes the tables
    tables = {path: path.stat().st_mtime_ns for path in (place / "map").glob("[!.]*.*")}
    assert len(tables) == 5
    command = [sys.executable, "-X", "importtime", "-m", "foldback.server.cli", "sweep", "map"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "foldback.planner.sweeps.sweep" in done.stderr
    for package in ("distributed", "pyarrow", "mujoco", "fastapi"):
        assert f" {package}\n" not in done.stderr
    del tables[place / "map" / "sweep.toml"]
    assert {path: path.stat().st_mtime_ns for path in tables} == tables


def test_sweep_on_this_machine_prints_rows(place: Path) -> None:
    """The bar is on a terminal, and the rows in a file."""
    options = ["--shape", "wrench-24", "--method", "direct", "--out", "new", "--workers", "1"]
    command = [sys.executable, "-m", "foldback.server.cli", "sweep", *options, "--json"]
    screen, terminal = pty.openpty()
    threading.Thread(target=_drain, args=(screen,), daemon=True).start()
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=terminal, text=True, check=False)
    assert done.returncode == 0
    (row,) = map(json.loads, done.stdout.splitlines())
    assert (row["shape"], row["method"], row["verified"]) == ("wrench-24", "direct", True)
    assert row["cpu_s"] > 0.0 and row["memory_mb"] > 10.0
    assert Rows(place / "new").read() == {row["key"]: row}
