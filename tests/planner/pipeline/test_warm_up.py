from __future__ import annotations

import os
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path as FilePath

import pytest
from numba import njit

from planner.pipeline import warm_up as module
from planner.pipeline.warm_up import warm_up
from planner.progress import COMPILING
from tests.compiled_later import compiled_later

pytestmark = pytest.mark.slow

IMPORTS = """
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
import trimesh
from planner.plan.formats import write_path
from planner.pathfinding.assembly import layered_snake
from planner.pipeline.fold_directory import write_request
from planner.chain.path import Path
from planner.plan.plan import Plan
from planner.pipeline.request import Request
from planner.pipeline.smooth import smooth_plan
from planner.pipeline.stages import run_stages
from planner.pipeline.warm_up import warm_up
"""
WORK = """
few = write_path(Path.from_cells(layered_snake((2, 2, 3)), name="few"))
path = write_path(Path.from_cells(layered_snake((4, 4, 4)), name="box"))
for strategy in ("simultaneous", "peel", "blocks"):
    with TemporaryDirectory() as place:
        write_request(FilePath(place), Request(strategy=strategy), path)
        assert run_stages(FilePath(place))["status"] == "verified", strategy
        if strategy == "simultaneous":
            assert smooth_plan(Plan.load(FilePath(place) / "plan.npz")).verified
for options in ({"preset": "paper"}, {"strategy": "one-by-one"}):
    with TemporaryDirectory() as place:
        write_request(FilePath(place), Request(**options), few)
        assert run_stages(FilePath(place))["status"] == "verified", options
box = trimesh.creation.box((2, 2, 3))
turned = box.copy()
turned.faces[3] = turned.faces[3][::-1]
for solid, module in ((box, "tetrahedron"), (turned, "cube")):
    with TemporaryDirectory() as place:
        request = Request(module=module, modules=24)
        write_request(FilePath(place), request, solid.export(file_type="off").encode())
        assert run_stages(FilePath(place))["status"] == "verified", module
"""


FIRST_WORD = """
import os
from planner.pipeline.warm_up import warm_up

def end(progress):
    print(progress.message, flush=True)
    os._exit(0)

warm_up(end)
"""


def test_that_it_compiles_is_told_when_it_begins(tmp_path: FilePath) -> None:
    answer = subprocess.run(
        [sys.executable, "-c", FIRST_WORD],
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (answer.stdout.strip(), answer.stderr) == (COMPILING, "")


def test_who_wants_to_fold_soon_leaves_the_rest_to_a_process_beside(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    beside: list[str] = []
    here: list[str] = []

    def start(part: str) -> nullcontext[None]:
        beside.append(part)
        return nullcontext()

    def noted(name: str) -> None:
        real = getattr(module, name)

        def noting(*given: object) -> None:
            here.append(name)
            real(*given)

        monkeypatch.setattr(module, name, noting)

    rest = ["retime", "smooth_plan", "_explode_as_published", "_peel", "warm_up_paths"]
    for name in rest:
        noted(name)
    monkeypatch.setattr(module, "beside", start)
    monkeypatch.setattr(module, "cores", lambda: 2)
    warm_up(soon=True)
    assert (beside, here) == ([], rest)
    here.clear()
    monkeypatch.setattr(module, "warm_up_chains", njit(lambda: 0))  # compiled at its first call
    warm_up(soon=True)
    assert (beside, here) == (["motions", "all"], [])


@pytest.mark.long
def test_nothing_is_compiled_afterwards_whatever_the_strategy() -> None:
    assert compiled_later(IMPORTS, WORK) == []
