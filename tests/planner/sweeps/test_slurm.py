"""Sweeps on a real SLURM, both ways: workers as an array of jobs, and jobs of the sweep itself."""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from foldback.planner.sweeps.rows import Rows
from tests.server.service_process import wait_until
from tests.slurm import Slurm

pytestmark = pytest.mark.long
SHAPES, SEEDS = ("wrench-160", "mallet-160", "cross"), 8  # long enough that Dask asks for both jobs
COMMAND = (sys.executable, "-P", "-m", "foldback.server.cli", "sweep")
OPTIONS = (*(f"--shape=gallery:{name}" for name in SHAPES), f"--seeds=0-{SEEDS - 1}", "--json")
ROWS_BEFORE_CANCEL = 5


@pytest.fixture
def slurm() -> Iterator[Slurm]:
    with closing(Slurm()) as cluster:
        yield cluster.start()


@contextmanager
def scheduler(slurm: Slurm) -> Iterator[Path]:
    """Run Dask's scheduler, as on the login node of a cluster, and yield its file."""
    path = slurm.directory / "scheduler.json"
    with open(slurm.directory / "scheduler.log", "wb") as log:
        process = subprocess.Popen(
            [
                *(sys.executable, "-m", "dask", "scheduler", "--scheduler-file", str(path)),
                *("--host", "127.0.0.1", "--port", "0", "--no-dashboard"),
            ],
            stdout=log,
            stderr=log,
        )
    try:
        wait_until(path.exists, slurm.log)
        yield path
    finally:
        process.terminate()
        process.wait()


def sweep_with_a_cancelled_job(slurm: Slurm, out: Path, *options: str) -> list[dict[str, Any]]:
    """Sweep, cancel the job of a worker in the middle, and return the printed rows."""
    rows: list[dict[str, Any]] = []
    with (
        open(slurm.directory / "sweep.log", "wb") as log,
        subprocess.Popen(
            [*COMMAND, *OPTIONS, f"--out={out}", *options],
            env=slurm.environment,
            cwd=slurm.jobs,
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
        ) as command,
    ):
        for line in command.stdout:
            rows.append(json.loads(line))
            if len(rows) == ROWS_BEFORE_CANCEL:
                wait_until(lambda: len(slurm.running()) == 2, slurm.log)
                slurm.run("scancel", slurm.running()[0])
    assert command.returncode == 0, slurm.log()
    return rows


def check_rows(rows: list[dict[str, Any]], out: Path) -> None:
    """Check that each fold has one row, on standard output and in the tables."""
    shapes_and_seeds = sorted((name, seed) for name in SHAPES for seed in range(SEEDS))
    assert sorted((row["shape"], row["seed"]) for row in rows) == shapes_and_seeds
    assert all(row["verified"] for row in rows)
    assert (
        len(Rows(out).read())
        == pq.read_table(out / "results.parquet").num_rows
        == len(shapes_and_seeds)
    )
    written = [line for path in (out / "rows").iterdir() for line in path.read_text().splitlines()]
    assert len(written) == len(shapes_and_seeds)


def test_array_of_workers_computes_all_folds_although_one_is_cancelled(
    slurm: Slurm, tmp_path: Path
) -> None:
    worker = f"{sys.executable} -m dask worker --nthreads 1 --lifetime 55m --lifetime-stagger 5m"
    with scheduler(slurm) as file:
        slurm.submit(f"{worker} --scheduler-file {file}", "--array=1-2")
        rows = sweep_with_a_cancelled_job(slurm, tmp_path / "out", f"--on={file}")
        check_rows(rows, tmp_path / "out")
        assert len(slurm.running()) == 1


def test_sweep_starts_jobs_and_replaces_a_cancelled_one(slurm: Slurm, tmp_path: Path) -> None:
    rows = sweep_with_a_cancelled_job(
        slurm, tmp_path / "out", "--on=slurm", "--workers=2", "--slurm=partition=cpu"
    )
    check_rows(rows, tmp_path / "out")
    wait_until(lambda: not slurm.running(), slurm.log)
    assert int(slurm.submit("true")) > 3  # a third job has replaced the cancelled one
