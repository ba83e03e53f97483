"""Warm-up: compiles the kernels into their cache, so that nobody waits for it later."""

from __future__ import annotations

import os
import sys
from contextlib import nullcontext
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from planner.certificate.measure import clearances_of
from planner.certificate.table import table_certificate
from planner.chain.chain import Chain
from planner.chain.dynamics import floating_torques
from planner.chain.module import CUBE
from planner.chain.path import Path
from planner.clearance.linked import exempt_pairs
from planner.cores import cores
from planner.explosion.paper import explode_as_published
from planner.pathfinding.assembly import layered_snake
from planner.pipeline.compiling import Compiling, alone, beside
from planner.pipeline.fold import fold
from planner.pipeline.fold_directory import write_request
from planner.pipeline.request import Request
from planner.pipeline.smooth import smooth_plan
from planner.pipeline.stages import run_stages
from planner.pipeline.warm_up_paths import SMALL_SHAPE, warm_up_chains, warm_up_paths
from planner.plan.formats import write_path
from planner.progress import Report, silent
from planner.robot.retiming import retime
from planner.simulation.parameters import PaperExplosionParameters

STEPPING_BACK: Final = 10
"""Niceness of what nobody waits for yet."""
SMALL_BOX: Final = (2, 4, 5)
"""More than one unit, so that some are let go and others are the last."""


def warm_up(progress: Report = silent, *, soon: bool = False) -> None:
    """Folds, retimes, smooths, balances, peels, explodes as published, finds a path.

    That takes a moment once it is compiled.

    Where nothing is compiled yet another process compiles a part of it at the same time. Of
    several processes that warm up one does at a time, so that the others find it compiled.

    Args:
        progress: Told ``COMPILING`` as soon as something has to be compiled.
        soon: Where something had to be compiled, come back once a path can be folded: the rest is
            compiled beside.
    """
    with alone(), Compiling(progress) as compiling:
        warm_up_chains()
        with beside("motions") if compiling.told and cores() > 1 else nullcontext():
            plan = fold(Path.from_cells(list(SMALL_SHAPE), name="warm-up"))
        if soon and compiling.told:
            beside("all")
            return
        retime(plan, 1.0, 1.0)
        smooth_plan(plan)
        table_certificate(plan.chain, plan.motion)
        warm_up_motions()
        _explode_as_published()
        _peel()
        warm_up_paths()


def warm_up_motions() -> None:
    """Looks at a motion as the playback and the certificate do; not at its clearance in between."""
    chain = warm_up_chains()
    still = np.tile(chain.folded_rad, (2, 1))
    floating_torques(CUBE, still, 0.0 * still, 0.0 * still)
    exempt_pairs(chain, (still,), size=0.95)
    clearances_of(chain, still, size=0.95)


def _explode_as_published() -> None:
    """Steps from hinges at their stops into the open, where nothing touches."""
    corner = Path.from_cells(((0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 1, 0), (2, 2, 0)))
    explode_as_published(Chain.from_path(corner), PaperExplosionParameters(max_steps=10))


def _peel() -> None:
    """What long chains need, which are too long for the simultaneous explosion."""
    path = Path.from_cells(layered_snake(SMALL_BOX), name="warm-up")
    with TemporaryDirectory(prefix="foldback-") as place:
        write_request(FilePath(place), Request(strategy="peel"), write_path(path))
        run_stages(FilePath(place))


def main() -> None:
    """Compiles what another process leaves to this one."""
    if sys.argv[1:] == ["motions"]:
        warm_up_motions()
    else:
        os.nice(STEPPING_BACK)
        warm_up()


if __name__ == "__main__":
    main()
