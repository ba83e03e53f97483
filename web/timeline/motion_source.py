"""Motion sources: a chain's motion, of which any frame can be shown; on disk or in memory."""

from __future__ import annotations

import secrets

import numpy as np

from planner.chain.chain import Chain
from planner.motion.motion import Motion
from web.palette import error_scale
from web.pictures.camera import straight_stretch
from web.timeline.view import Snapshot, TimelineView, moment_of


class MotionMoments:
    """Motion in memory: poses by forward kinematics, computed on request."""

    growing = False

    def __init__(self, chain: Chain, motion: Motion, motion_id: str | None = None) -> None:
        """Take a motion; ``motion_id`` is that of the timeline that it was read from, if any."""
        self.id = motion_id or secrets.token_hex(8)
        self.chain = chain
        self._motion = motion
        self.stretch = straight_stretch(chain) if motion.is_windowed else None
        known = motion.largest_errors
        self.error_scale_rad = error_scale(float(np.max(known, where=known > 0.0, initial=0.0)))

    def __len__(self) -> int:
        return len(self._motion)

    def snapshot(self, frame: float) -> Snapshot:
        """Return the recorded moment nearest to ``frame``."""
        k = min(max(round(frame), 0), len(self) - 1)
        return moment_of(self.chain, self._motion, k, frame=k, stretch=self.stretch)


MotionSource = TimelineView | MotionMoments
"""Motion that can be shown."""
