"""Snapshots of a peeling: windows of hinges, proved as the certificate proves them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import ClassVar, Final

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.clearance.sweep import windows_shape
from foldback.planner.core import sweep_frames, window_distances
from foldback.planner.core.structures import Angles
from foldback.planner.explosion.loop.recorder import MIN_CLEARANCE_LOSS_PITCH
from foldback.planner.explosion.peeling.window import Peelable, WindowConfiguration
from foldback.planner.motion.angle_encoding import quantised
from foldback.planner.motion.motion import Motion

MIN_ROD_COSINE: Final = float(np.cos(0.1))
"""Cosine of the maximum turn of the rod from one snapshot to the next, 0.1 rad."""


class Proof:
    """Proof of the clearance at and between snapshots, as in the certificate, at one module size.

    Folded modules are not checked against each other, nor are straight ones: they do not change.
    """

    def __init__(self, chain: Chain, module_size: float) -> None:
        # Folded neighbours are no farther apart than the module size leaves.
        # Half the gap between neighbours in the folded shape, but for rounding.
        self.min_clearance = min(0.002, 0.5 * (1.0 - module_size) - 1e-9)
        """Minimum clearance of snapshots, pitches."""
        self._hinges = chain.module.hinges_per_joint
        self._shape = windows_shape(chain, module_size)

    def is_clear(self, configurations: Sequence[WindowConfiguration]) -> bool:
        """Return True if configurations, and the motion between them, keep that clearance."""
        return self.keeps(configurations, self.min_clearance)[0] >= self.min_clearance

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
        values = np.concatenate([bend.angles for bend in bends])
        angles = Angles(
            first=np.array([self._hinges * bend.first for bend in bends], dtype=np.int64),
            offsets=_offsets(bends),
            shift=0,
            values=values.astype(np.float32).astype(np.float64),
        )
        caps, per_frame = np.array([enough] * count), np.array([enough] * count)
        result = sweep_frames(self._shape, angles, 0, count, enough, caps, per_frame, 0.0)
        proved = result.lower_bound > 0.0
        return (result.clearance if proved else min(result.clearance, 0.0)), per_frame


@dataclass(frozen=True, slots=True)
class WindowRule:
    """Rule for configurations that are folded, bent, then straight.

    Snapshots are chosen by a proof of clearance, at and between them, as in the certificate.

    Attributes:
        peelable: The chain.
        proof: Proof of its clearance.
        snapshot_rad: Maximum turn of a hinge from one snapshot to the next, rad.
        snapshot_distance: Maximum distance that a module of both windows moves, pitches.
    """

    peelable: Peelable
    proof: Proof
    snapshot_rad: float
    snapshot_distance: float
    commits_all: ClassVar[bool] = True

    def are_far(self, a: WindowConfiguration, b: WindowConfiguration) -> bool:
        """Return True if two snapshots are farther apart than allowed."""
        folded_rad, hinges = self.peelable.chain.folded_rad, self.peelable.hinges
        turn, distance, cosine = window_distances(a.bent, b.bent, folded_rad, hinges)
        return (
            turn >= self.snapshot_rad
            or cosine < MIN_ROD_COSINE
            or distance >= self.snapshot_distance
        )

    def clearance(
        self, a: WindowConfiguration, b: WindowConfiguration, *, divisible: bool
    ) -> float | None:
        """Return the proved clearance; None if it is less between two snapshots than at them."""
        clearance, clearances = self.proof.keeps((a, b), 0.02)
        closer = divisible and clearance < clearances.min() - MIN_CLEARANCE_LOSS_PITCH
        return None if closer else clearance

    def motion(self, snapshots: list[WindowConfiguration]) -> Motion:
        """Return snapshots as a windowed motion."""
        chain, hinges, count = self.peelable.chain, self.peelable.hinges, len(snapshots)
        return Motion.from_windows(
            time_s=np.array([s.time_s for s in snapshots]),
            phase="explosion",
            first=np.array([hinges * s.first for s in snapshots], dtype=np.int64),
            offsets=_offsets(snapshots),
            angles_rad=quantised(np.concatenate([s.angles for s in snapshots])).astype(np.float32),
            base_position=np.repeat(chain.folded_position[None], count, axis=0),
            base_wxyz=np.repeat(chain.folded_wxyz[None], count, axis=0),
        )


def _offsets(bends: Sequence[WindowConfiguration]) -> Ints:
    """Return the (F + 1,) places in one array at which the angles of F windows begin and end."""
    return np.array([0, *accumulate(len(bend.angles) for bend in bends)], dtype=np.int64)
