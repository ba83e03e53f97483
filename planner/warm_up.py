"""Warm-up: compiles the kernels into their cache, so that nobody waits for it later."""

from __future__ import annotations

from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from planner.dynamics import floating_torques
from planner.fold_files import write_request
from planner.folding import fold
from planner.formats import write_path
from planner.measuring import clearances_of
from planner.modules import CUBE
from planner.pathfinding.assembly import layered_snake
from planner.paths import Path
from planner.request import Request
from planner.retiming import retime
from planner.smooth_plan import smooth_plan
from planner.stages import run_stages
from planner.warm_up_paths import SMALL_SHAPE, warm_up_chains, warm_up_paths

SMALL_BOX: Final = (2, 4, 5)
"""More than one unit, so that some are let go and others are the last."""


def warm_up() -> None:
    """Finds a path, folds, retimes, smooths, peels tiny shapes: a moment once compiled."""
    warm_up_paths()
    plan = fold(Path.from_cells(list(SMALL_SHAPE), name="warm-up"))
    retime(plan, 1.0, 1.0)
    smooth_plan(plan)
    chain = warm_up_chains()
    still = np.tile(chain.folded_rad, (2, 1))
    clearances_of(chain, still, size=0.95)
    floating_torques(CUBE, still, 0.0 * still, 0.0 * still)
    _peel()


def _peel() -> None:
    """What long chains need, which are too long for the simultaneous explosion."""
    path = Path.from_cells(layered_snake(SMALL_BOX), name="warm-up")
    with TemporaryDirectory(prefix="foldback-") as place:
        write_request(FilePath(place), Request(strategy="peel"), write_path(path))
        run_stages(FilePath(place))
