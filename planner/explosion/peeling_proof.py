"""Proof of the clearance of a peeled chain at and between snapshots, as in the certificate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.clearance.sweep import windows_shape
from planner.explosion.peeling_window import WindowConfiguration
from planner.kernels.sweep import Angles, sweep_frames

Array = NDArray[np.float64]


class Proof:
    """The sweep of a motion, for a few configurations at a time and at one module size.

    Folded modules are not checked against each other, nor are straight ones: they do not change.
    """

    def __init__(self, chain: Chain, size: float) -> None:
        self._hinges = chain.module.hinges_per_joint
        self._shape = windows_shape(chain, size)

    def keeps(self, bends: Sequence[WindowConfiguration], enough: float) -> tuple[float, Array]:
        """Return the least clearance of configurations and of the linear motion between them.

        Args:
            bends: F configurations, in their order; their angles count in single precision.
            enough: Cap of the clearances, pitches: larger ones count as this.

        Returns:
            The least of all, not above 0 where the motion between two could not be proved, and
            (F,) that of each configuration; pitches.
        """
        count = len(bends)
        lengths = [len(bend.angles) for bend in bends]
        values = np.concatenate([bend.angles for bend in bends])
        angles = Angles(
            first=np.array([self._hinges * bend.first for bend in bends], dtype=np.int64),
            offsets=np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
            shift=0,
            values=values.astype(np.float32).astype(np.float64),
        )
        per_frame = np.full(count, enough)
        found = sweep_frames(
            self._shape, angles, 0, count, enough, np.full(count, enough), per_frame, 0.0
        )
        proved = found.lower_bound > 0.0
        return (found.clearance if proved else min(found.clearance, 0.0)), per_frame
