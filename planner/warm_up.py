"""Warm-up: compiles the kernels into their cache, so that nobody waits for it later."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from numba.core.event import Event, Listener, install_listener

from planner.cores import cores
from planner.dynamics import floating_torques
from planner.fold_files import write_request
from planner.folding import fold
from planner.formats import write_path
from planner.linked import exempt_pairs
from planner.measuring import clearances_of
from planner.modules import CUBE
from planner.pathfinding.assembly import layered_snake
from planner.paths import Path
from planner.progress import COMPILING, Progress, Report, silent
from planner.request import Request
from planner.retiming import retime
from planner.smooth_plan import smooth_plan
from planner.stages import run_stages
from planner.warm_up_paths import SMALL_SHAPE, warm_up_chains, warm_up_paths

COMPILE: Final = "numba:compile"
"""What the compiler calls what it tells its listeners."""
REST_NICENESS: Final = 10
"""A first fold goes before what others will need."""
SMALL_BOX: Final = (2, 4, 5)
"""More than one unit, so that some are let go and others are the last."""


def warm_up(progress: Report = silent, *, soon: bool = False) -> None:
    """Folds, retimes, smooths, peels tiny shapes, finds a path: a moment once compiled.

    Where nothing is compiled yet another process compiles a part of it at the same time. What finds
    paths comes last: the service's process for previews has compiled it by then.

    Args:
        progress: Told ``COMPILING`` as soon as something has to be compiled.
        soon: Where something had to be compiled, come back once a path can be folded: a process
            beside, which steps back, goes on with what peels, smooths and retimes.
    """
    compiling = _Compiling(progress)
    with install_listener(COMPILE, compiling):
        warm_up_chains()
        with _beside("motions") if compiling.told and cores() > 1 else nullcontext():
            plan = fold(Path.from_cells(list(SMALL_SHAPE), name="warm-up"))
        if soon and compiling.told:
            _beside("rest")
            return
        retime(plan, 1.0, 1.0)
        smooth_plan(plan)
        warm_up_motions()
        _peel()
        warm_up_paths()


def warm_up_motions() -> None:
    """Looks at a motion as the playback and the certificate do; not at its clearance in between."""
    chain = warm_up_chains()
    still = np.tile(chain.folded_rad, (2, 1))
    floating_torques(CUBE, still, 0.0 * still, 0.0 * still)
    exempt_pairs(chain, (still,), size=0.95)
    clearances_of(chain, still, size=0.95)


def _beside(part: str) -> subprocess.Popen[bytes]:
    """Compiles a part in another process."""
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "planner.warm_up", part],
        stdin=subprocess.DEVNULL,  # ours is for requests
    )


class _Compiling(Listener):
    """Tells once that something is compiled, when it begins."""

    def __init__(self, progress: Report) -> None:
        self._progress = progress
        self.told = False

    def on_start(self, event: Event) -> None:
        if not self.told:
            self.told = True
            self._progress(Progress(stage="read", fraction=0.0, message=COMPILING))

    def on_end(self, event: Event) -> None:
        pass


def _peel() -> None:
    """What long chains need, which are too long for the simultaneous explosion."""
    path = Path.from_cells(layered_snake(SMALL_BOX), name="warm-up")
    with TemporaryDirectory(prefix="foldback-") as place:
        write_request(FilePath(place), Request(strategy="peel"), write_path(path))
        run_stages(FilePath(place))


def main() -> None:
    """Compiles what a process beside has left to this one."""
    if sys.argv[1:] == ["motions"]:
        warm_up_motions()
    else:
        os.nice(REST_NICENESS)
        warm_up()


if __name__ == "__main__":
    main()
