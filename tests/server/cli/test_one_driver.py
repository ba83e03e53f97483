"""One driver: a fold in the service, on the command line and in memory comes to the same."""

from pathlib import Path

import pytest

from foldback.planner.chain.path import Path as CellPath
from foldback.planner.pipeline.derived_files import complete
from foldback.planner.pipeline.fold import fold
from foldback.planner.readers import read
from foldback.planner.storage.file_names import INPUT, PLAN
from tests.golden.digests import digests
from tests.server.cli.test_command_line import foldback
from tests.server.service_process import FinishedFold

pytestmark = pytest.mark.slow


def test_service_command_line_and_memory_compute_the_same(
    finished: FinishedFold, tmp_path: Path
) -> None:
    data = (finished.directory / INPUT).read_bytes()
    file, directory = tmp_path / "path.json", tmp_path / "fold"
    file.write_bytes(data)
    options = ("--seed", "3", "--strategy", "simultaneous")
    assert foldback("fold", file, "--out", directory, *options).returncode == 0
    complete(directory)
    assert finished.http.get(f"{finished.page}/figures").status_code == 200
    computed = digests(finished.directory)
    assert digests(directory) == computed

    shape = read(data, filename=file.name)
    assert isinstance(shape, CellPath)
    plan = fold(shape, seed=3, strategy="simultaneous")
    plan.save_npz(tmp_path / PLAN)
    assert digests(tmp_path) == {PLAN: computed[PLAN]}
