"""Active window: the modules between the folded core and the straight rod."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.explosion.peeling_core import Core
from planner.kernels.kinematics import chain_poses

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WindowConfiguration:
    """A configuration of a chain that is folded, then bent, then straight.

    Attributes:
        time_s: Simulated time, s.
        first: First module of the window; it and the next one belong to the core.
        angles: (H,) angles of the window's hinges, rad; the modules after them are straight.
        centres: (m, 3) centres of the window's modules, pitches; None if unknown.
        along: (3,) unit vector of the rod; None if unknown.
    """

    time_s: float
    first: int
    angles: Array
    centres: Array | None = None
    along: Array | None = None


class Peelable:
    """A chain that is peeled: its core, and the poses of its windows."""

    def __init__(self, chain: Chain) -> None:
        self.chain = chain
        self.core = Core(chain)
        self.hinges = chain.module.hinges_per_joint
        self._bent = np.concatenate([[0.0], np.cumsum(np.abs(chain.folded_rad))])

    def __len__(self) -> int:
        """Return the number of modules."""
        return len(self.chain)

    def modules(self, angles: Array) -> int:
        """Return the number of modules of a window with these hinges."""
        return len(angles) // self.hinges + 2

    def bent_below(self, first: int) -> float:
        """Return the sum of the folded angles before a window, rad."""
        return float(self._bent[self.hinges * first])

    def widened(self, bend: WindowConfiguration, first: int, hinges: int) -> Array:
        """Return the (hinges,) angles of a wider window that begins with an earlier module."""
        k = self.hinges
        found = np.zeros(hinges)
        lead = k * (bend.first - first)
        found[:lead] = self.chain.folded_rad[k * first : k * bend.first]
        found[lead : lead + len(bend.angles)] = bend.angles
        return found

    def together(self, a: WindowConfiguration, b: WindowConfiguration) -> tuple[int, Array, Array]:
        """Return the first module and the angles of two configurations in their common window."""
        k = self.hinges
        first = min(a.first, b.first)
        end = max(k * a.first + len(a.angles), k * b.first + len(b.angles))
        count = end - k * first
        return first, self.widened(a, first, count), self.widened(b, first, count)

    def base(self, first: int) -> tuple[Array, Array]:
        """Return the (3,) and (3, 3) pose of a window's first module, straight behind its second.

        The joint between them is folded, so this is not the pose of that module in the chain.
        """
        rotation = self.core.rotations[first + 1]
        return self.core.cells[first + 1] - rotation[:, 0], rotation

    def poses(self, first: int, angles: Array) -> tuple[Array, Array]:
        """Return (m, 3) centres and (m, 3, 3) orientations of a window's modules, see ``base``."""
        module = self.chain.module
        m = self.modules(angles)
        positions, rotations = np.empty((m, 3)), np.empty((m, 3, 3))
        chain_poses(
            angles,
            module.joint,
            0,
            *self.base(first),
            positions,
            rotations,
        )
        return positions, rotations
