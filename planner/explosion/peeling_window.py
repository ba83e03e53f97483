"""Window: the modules between the folded core and the straight rod."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.explosion.peeling_core import Core
from planner.kernels.kinematics import chain_poses

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bend:
    """A configuration of a chain that is folded, then bent, then straight.

    Attributes:
        time_s: When.
        first: The window's first module; it and the next one belong to the core.
        angles: (H,) angles of the window's hinges; the modules after them are straight.
        centres: (m, 3) the window's modules; None where they are not known.
        along: (3,) the rod's direction; None where it is not known.
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
        """Number of modules."""
        return len(self.chain)

    def modules(self, angles: Array) -> int:
        """Modules of a window with these hinges."""
        return len(angles) // self.hinges + 2

    def bent_below(self, first: int) -> float:
        """Sum of the folded angles before a window."""
        return float(self._bent[self.hinges * first])

    def widened(self, bend: Bend, first: int, hinges: int) -> Array:
        """(hinges,) angles of a wider window that begins with an earlier module."""
        k = self.hinges
        found = np.zeros(hinges)
        lead = k * (bend.first - first)
        found[:lead] = self.chain.folded_rad[k * first : k * bend.first]
        found[lead : lead + len(bend.angles)] = bend.angles
        return found

    def together(self, a: Bend, b: Bend) -> tuple[int, Array, Array]:
        """First module and the angles of two configurations in a window that holds both."""
        k = self.hinges
        first = min(a.first, b.first)
        end = max(k * a.first + len(a.angles), k * b.first + len(b.angles))
        count = end - k * first
        return first, self.widened(a, first, count), self.widened(b, first, count)

    def base(self, first: int) -> tuple[Array, Array]:
        """(3,) and (3, 3) pose of a window's first module, drawn straight behind its second.

        The joint between them is folded, so it is not where the chain has that module.
        """
        rotation = self.core.rotations[first + 1]
        return self.core.cells[first + 1] - rotation[:, 0], rotation

    def poses(self, first: int, angles: Array) -> tuple[Array, Array]:
        """(m, 3) centres and (m, 3, 3) orientations of a window's modules, see ``base``."""
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
