"""Warm-up: compiles the kernels into their cache, so that nobody waits for it later."""

from __future__ import annotations

import numpy as np

from planner.chain import Chain
from planner.dynamics import floating_torques
from planner.folding import fold
from planner.frames import Frames
from planner.measuring import clearances_of
from planner.modules import CUBE
from planner.paths import Path
from planner.retiming import retime
from planner.sweep import sweep
from planner.warm_up_paths import SMALL_SHAPE, warm_up_chains, warm_up_paths
from planner.windows import Windows


def warm_up() -> None:
    """Finds a path, folds and retimes a tiny shape: seconds the first time, then a moment."""
    warm_up_paths()
    retime(fold(Path.from_cells(list(SMALL_SHAPE), name="warm-up")), 1.0, 1.0)
    chain = warm_up_chains()
    still = np.tile(chain.folded_rad, (2, 1))
    clearances_of(chain, still, size=0.95)
    sweep(chain, _windows(chain), size=0.95)
    floating_torques(CUBE, still, 0.0 * still, 0.0 * still)


def _windows(chain: Chain) -> Windows:
    """One folded snapshot."""
    frame = Frames.of_phase(
        "explosion",
        time_s=np.zeros(1),
        joint_angles_rad=chain.folded_rad[None],
        root_position=np.zeros((1, 3)),
        root_wxyz=np.array([[1.0, 0.0, 0.0, 0.0]]),
    )
    return Windows.of(chain, frame)
