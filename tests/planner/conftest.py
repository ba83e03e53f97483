import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from fcntl import LOCK_EX, flock
from functools import cache
from pathlib import Path as FilePath

import pytest

from planner.chain.chain import Chain
from planner.chain.path import Path
from planner.motion.record import Record
from planner.parameters.parameters import Parameters
from planner.pipeline.request import FoldRequest
from planner.pipeline.stages import run_stages
from planner.pipeline.workspace import Workspace
from planner.plan.plan import Plan
from planner.playback.playback import Playback

SHAPES = FilePath(__file__).parents[2] / "examples" / "shapes"


@pytest.fixture
def hook() -> Path:
    """Path of five cells: along x, then y, then z."""
    cells = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 1, 0), (2, 1, 1)]
    return Path.from_cells(cells, name="hook", pitch_m=0.02)


@pytest.fixture
def hook_chain(hook: Path) -> Chain:
    """Chain that folds into the hook."""
    return Chain.from_path(hook)


@dataclass(frozen=True)
class Folded:
    """Fold that has passed all stages, with their results; tests must not change it."""

    directory: FilePath
    chain: Chain
    parameters: Parameters
    record: Record | None
    playback: Playback | None
    plan: Plan


Fold = Callable[..., Folded]


@pytest.fixture(scope="session")
def folded(tmp_path_factory: pytest.TempPathFactory) -> Fold:
    """Function that folds an example shape once for all tests: ``folded("wrench-24")``.

    Test processes share the folds, too.
    """
    shared = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent

    @cache
    def fold_shape(shape: str, preset: str = "default", seed: int = 0) -> Folded:
        directory = shared / f"folded-{shape}-{preset}-{seed}"
        request = FoldRequest(preset=preset, seed=seed)
        with open(directory.with_suffix(".lock"), "w") as lock:
            flock(lock, LOCK_EX)
            if not directory.exists():
                making = directory.with_suffix(".making")
                shutil.rmtree(making, ignore_errors=True)
                making.mkdir()
                Workspace(making).write_request(request, (SHAPES / f"{shape}.json").read_bytes())
                run_stages(making)
                making.rename(directory)
        record, playback = directory / "record.npz", directory / "playback.npz"
        plan = Plan.load(directory / "plan.npz")
        return Folded(
            directory=directory,
            chain=plan.chain,
            parameters=request.parameters(),
            record=Record.load(record) if record.exists() else None,
            playback=Playback.load(playback) if playback.exists() else None,
            plan=plan,
        )

    return fold_shape
