import os
import subprocess
import sys
from contextlib import nullcontext, suppress
from pathlib import Path as FilePath
from types import SimpleNamespace

import psutil
import pytest
from numba import njit

from foldback.planner.chain.chain import Chain
from foldback.planner.compilation.compiling_lock import FIRST_KERNELS_BYTES, FIRST_LOCK
from foldback.planner.pipeline import warm_up as module
from foldback.planner.pipeline.warm_up import warm_up
from foldback.planner.progress import COMPILING
from tests.compiled_later import compiled_later
from tests.server.service_process import TIMEOUT_S

pytestmark = pytest.mark.slow

IMPORTS = """
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
import trimesh
from foldback.planner.chain.path import Path
from foldback.planner.pathfinding.assembly import layered_snake
from foldback.planner.pathfinding.knots import knot_of
from foldback.planner.pipeline.fold import smooth_plan
from foldback.planner.pipeline.warm_up import warm_up
from foldback.planner.plan.shape_writers import write_path
from tests.planner.chains import walk
from tests.planner.folds import run_fold
from tests.planner.pathfinding.test_knots import OVERHAND
"""
WORK = """
def folded(data, **options):
    with TemporaryDirectory() as place:
        plan = run_fold(FilePath(place), data, **options)
        assert plan.verified, options
        return plan

assert knot_of(walk(OVERHAND)).verdict == "knotted"
few = write_path(Path.from_cells(layered_snake((2, 2, 3)), name="few"))
path = write_path(Path.from_cells(layered_snake((4, 4, 4)), name="box"))
assert smooth_plan(folded(path, strategy="simultaneous")).verified
for options in ({"strategy": "peel"}, {"strategy": "blocks"}):
    folded(path, **options)
for options in ({"preset": "paper"}, {"strategy": "one-by-one"}):
    folded(few, **options)
box = trimesh.creation.box((2, 2, 3))
turned = box.copy()
turned.faces[3] = turned.faces[3][::-1]
for solid, module in ((box, "tetrahedron"), (turned, "cube")):
    folded(solid.export(file_type="off").encode(), module=module, modules=24)
"""


def run(script: str, *arguments: FilePath, kernels: FilePath) -> str:
    """Run a script that has compiled no kernel yet, and return its output."""
    answer = subprocess.run(
        [sys.executable, "-c", script, *map(str, arguments)],
        env={**os.environ, "NUMBA_CACHE_DIR": str(kernels)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert answer.stderr == ""
    return answer.stdout.strip()


def test_warm_up_reports_that_it_compiles_from_the_beginning(tmp_path: FilePath) -> None:
    script = """
import os
from foldback.planner.pipeline.warm_up import warm_up

def end(progress):
    print(progress.message, flush=True)
    os._exit(0)

warm_up(end)
"""
    assert run(script, kernels=tmp_path) == COMPILING


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL")
def test_process_beside_ends_when_its_parent_is_killed(tmp_path: FilePath) -> None:
    script = """
import os, signal, sys
from pathlib import Path
from foldback.planner.compilation.compiling import beside
print(beside("all", Path(sys.argv[1])).pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""
    # it needs minutes to finish
    number = int(run(script, tmp_path, kernels=tmp_path / "kernels"))
    with suppress(psutil.NoSuchProcess):
        orphan = psutil.Process(number)
        try:
            orphan.wait(TIMEOUT_S)
        finally:
            orphan.kill()


@pytest.mark.long
def test_first_kernels_have_the_bytecode_that_fractions_are_shown_of(tmp_path: FilePath) -> None:
    script = """
import sys
from pathlib import Path
from foldback.planner.pipeline.warm_up import warm_up

warm_up(soon=True, directory=Path(sys.argv[1]))
"""
    run(script, tmp_path, kernels=tmp_path / "kernels")
    assert (tmp_path / FIRST_LOCK).stat().st_size == pytest.approx(FIRST_KERNELS_BYTES, rel=0.2)


def test_warm_up_for_a_fold_soon_leaves_the_rest_to_another_process(
    monkeypatch: pytest.MonkeyPatch, tmp_path: FilePath
) -> None:
    beside: list[str] = []
    calls: list[str] = []

    def start(part: str, directory: FilePath, *extra: object) -> nullcontext[None]:
        beside.append(part)
        return nullcontext()

    first = ["warm_up_clearance", "warm_up_torques", "warm_up_motions"]
    lazy_kernels = ["retime", "smooth_plan", "table_certificate", "_many_contacts"]
    lazy_kernels += ["_explode_as_published", "warm_up_paths", "_peel", "warm_up_fit", "_turn"]
    for name in first + lazy_kernels:
        monkeypatch.setattr(module, name, lambda *_, name=name, **__: calls.append(name))
    plan = SimpleNamespace(chain=None, motion=None)
    monkeypatch.setattr(module, "fold", lambda *_, **__: plan)  # pyright: ignore[reportUnknownLambdaType]
    monkeypatch.setattr(module, "beside", start)
    monkeypatch.setattr(module, "second_process", start)
    monkeypatch.setattr(module, "cores", lambda: 2)
    warm_up(soon=True, directory=tmp_path)
    assert (beside, calls) == ([], first + lazy_kernels)
    assert not list(tmp_path.iterdir())  # no lock was taken
    calls.clear()
    new_kernel, chains = njit(lambda: 0), module.warm_up_chains

    def chains_by_new_kernel() -> Chain:
        new_kernel()
        return chains()

    monkeypatch.setattr(module, "warm_up_chains", chains_by_new_kernel)
    warm_up(soon=True, directory=tmp_path)
    assert (beside, calls) == (["paths-and-motions", "all"], first)
    calls.clear()
    beside.clear()
    monkeypatch.setattr(module, "warm_up_chains", chains)
    monkeypatch.setattr(module, "retime", lambda *_: njit(lambda: 0)())  # pyright: ignore[reportUnknownLambdaType]
    warm_up(at_once=True, directory=tmp_path)
    assert (beside, calls) == (["turns"], first + lazy_kernels[1:])


@pytest.mark.long
def test_no_strategy_compiles_anything_after_the_warm_up() -> None:
    assert compiled_later(IMPORTS, WORK) == []
