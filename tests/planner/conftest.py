import os
import shutil
from dataclasses import dataclass
from fcntl import LOCK_EX, flock
from pathlib import Path as FilePath

import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.motion.record import Record
from foldback.planner.pipeline.derived_files import complete
from foldback.planner.plan.plan import Plan
from foldback.planner.playback.playback import Playback
from tests.planner.folds import run_fold

SHAPES = FilePath(__file__).parents[2] / "examples" / "shapes"


@pytest.fixture
def hook_chain() -> Chain:
    """Chain that folds into five cells: along x, then y, then z."""
    cells = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 1, 0), (2, 1, 1)]
    return Chain.from_path(Path.from_cells(cells, name="hook", pitch_m=0.02))


@dataclass(frozen=True)
class Folded:
    """Fold that has passed all stages, with their results; tests must not change it."""

    directory: FilePath
    chain: Chain
    record: Record
    playback: Playback
    plan: Plan


@pytest.fixture(scope="session")
def folded(tmp_path_factory: pytest.TempPathFactory) -> Folded:
    """Fold of the example shape ``wrench-24``, which test processes share."""
    shared = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent
    directory = shared / "folded-wrench-24"
    with open(directory.with_suffix(".lock"), "w") as lock:
        flock(lock, LOCK_EX)
        if not directory.exists():
            making = directory.with_suffix(".making")
            shutil.rmtree(making, ignore_errors=True)
            run_fold(making, (SHAPES / "wrench-24.json").read_bytes(), strategy="simultaneous")
            complete(making)
            making.rename(directory)
    plan = Plan.load(directory / "plan.npz")
    return Folded(
        directory=directory,
        chain=plan.chain,
        record=Record.load(directory / "record.npz"),
        playback=Playback.load(directory / "playback.npz"),
        plan=plan,
    )
