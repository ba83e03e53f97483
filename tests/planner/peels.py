"""Long motions as windows, made by kinematics alone, without collision checks."""

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.motion.motion import Motion
from foldback.planner.pathfinding.snake import snake_path
from tests.planner.chains import Array, chain_of


def snake(sides: tuple[int, int, int]) -> Chain:
    """Return a box, filled layer by layer along z: the last module is in the top layer."""
    cells = snake_path(sides, axes=(0, 1, 2))
    return chain_of(cells, "snake")


def windows_of(chain: Chain, first: list[int], angles: list[Array]) -> Motion:
    """Return windows that begin at the hinges ``first`` and have the ``angles``."""
    count = len(first)
    return Motion.from_windows(
        time_s=np.arange(count, dtype=np.float64),
        phase="explosion",
        first=np.array(first, dtype=np.int64),
        offsets=np.concatenate([[0], np.cumsum([len(a) for a in angles])]).astype(np.int64),
        angles_rad=np.concatenate([np.zeros(0), *angles]).astype(np.float32),
        base_position=np.tile(chain.folded_position, (count, 1)),
        base_wxyz=np.tile(chain.folded_wxyz, (count, 1)),
    )


def peel(chain: Chain, *, width: int, step: float) -> Motion:
    """Straighten a chain from its far end, one hinge of a window after the other.

    The fraction of its folded angle that a hinge has decreases linearly along the window, and the
    window moves down the chain by ``step`` hinges per frame.

    Args:
        chain: Chain to straighten.
        width: Number of hinges of a window.
        step: Hinges per frame.
    """
    count = len(chain.folded_rad)
    starts = np.arange(count, -width - step, -step)
    first: list[int] = []
    angles: list[Array] = []
    for start in starts:
        low = max(0, int(np.ceil(start)))
        high = max(low, min(count, int(np.ceil(start + width))))
        hinges = np.arange(low, high)
        share = 1.0 - np.clip((hinges - start) / width, 0.0, 1.0)
        first.append(low)
        angles.append(share * chain.folded_rad[low:high])
    return windows_of(chain, first, angles)
