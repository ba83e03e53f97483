"""Motion figures: how calmly the hinges of a plan move, from its angles alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from foldback.planner.arrays import FRAMES_AT_ONCE, Array
from foldback.planner.chain.chain import Chain
from foldback.planner.motion.motion import PHASES, Motion

MIN_COUNTED_MOTION_RAD: Final = float(np.deg2rad(1.0))
"""Minimum motion of a hinge that counts as a reversal, or as a detour, rad: one degree, which
is barely visible."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionFigures:
    """Figures of the hinges' motion over all frames.

    Attributes:
        travel_ratio: Σ|Δq| over frames and hinges, divided by the least possible value: Σ|Δq| from
            the first to the last frame; for a refold, from the first frame to straight plus from
            straight to the last. None if nothing has to move.
        reversals_mean: Mean number of changes of direction of a hinge, counted when it has gone
            back by one degree.
        detours: Number of hinges that move by more than one degree although they end where they
            began; for a refold, in either of its two parts.
        largest_detour_rad: Largest distance of such a hinge from where it began, rad.
    """

    travel_ratio: float | None
    reversals_mean: float
    detours: int
    largest_detour_rad: float

    @classmethod
    def of(cls, chain: Chain, motion: Motion) -> MotionFigures | None:
        """Return the figures of a plan's motion; None if it is too long or has one frame."""
        hinges = len(chain.folded_rad)
        if len(motion) < 2 or len(motion) * hinges > 2**26:  # 512 MB
            return None
        straight = int((motion.phase == PHASES.index("unfolding")).sum())
        ends = [0, straight, len(motion) - 1] if straight else [0, len(motion) - 1]
        travel = np.zeros(hinges)
        shortest = np.zeros(hinges)
        detour = np.zeros(hinges)
        reversals = np.zeros(hinges, dtype=np.int64)
        for first, last in zip(ends[:-1], ends[1:], strict=True):
            start_angles, end = (motion.angles_at(chain, frame) for frame in (first, last))
            shortest += np.abs(end - start_angles)
            part = _Part(start_angles)
            for start in range(first + 1, last + 1, FRAMES_AT_ONCE):
                stop = min(start + FRAMES_AT_ONCE, last + 1)
                part.add(motion.angles(chain, start, stop))
            travel += part.travel
            reversals += part.reversals
            returns = np.abs(end - start_angles) < MIN_COUNTED_MOTION_RAD
            detour = np.maximum(detour, np.where(returns, part.largest, 0.0))
        counted = detour > MIN_COUNTED_MOTION_RAD
        needed = float(shortest.sum())
        return cls(
            travel_ratio=float(travel.sum()) / needed if needed > MIN_COUNTED_MOTION_RAD else None,
            reversals_mean=float(reversals.mean()),
            detours=int(counted.sum()),
            largest_detour_rad=float(detour[counted].max(initial=0.0)),
        )


class _Part:
    """Sums over the frames of one part of a motion.

    Args:
        start: (J,) angles of its first frame, rad.
    """

    def __init__(self, start: Array) -> None:
        self._start = start
        self._last = start
        self._turning_point = start.copy()
        self._direction = np.zeros(len(start), dtype=np.int64)
        self.travel = np.zeros(len(start))
        self.largest = np.zeros(len(start))
        self.reversals = np.zeros(len(start), dtype=np.int64)

    def add(self, angles: Array) -> None:
        """Add (F, J) angles of the next frames, rad."""
        steps = np.abs(np.diff(angles, axis=0, prepend=self._last[None]))
        self.travel += steps.sum(axis=0)
        self.largest = np.maximum(self.largest, np.abs(angles - self._start).max(axis=0))
        self._last = angles[-1]
        for row in angles:
            # The turning point is the farthest angle so far in the present direction.
            moved = row - self._turning_point
            forward = self._direction * moved > 0.0
            turned = (np.abs(moved) >= MIN_COUNTED_MOTION_RAD) & ~forward
            self.reversals += turned & (self._direction != 0)
            self._direction = np.where(turned, np.sign(moved), self._direction).astype(np.int64)
            self._turning_point = np.where(forward | turned, row, self._turning_point)
