"""Motion sources: a chain's motion, of which any frame can be shown; on disk or in memory."""

from __future__ import annotations

import secrets
from typing import Protocol

import numpy as np

from planner.chain.chain import Chain
from planner.motion.motion import PHASES, Motion
from web.pictures.camera import modules_framed, straight_stretch
from web.pictures.colours import error_scale
from web.timeline.view import Snapshot, chain_errors


class MotionSource(Protocol):
    """Motion that can be shown, such as a ``web.timeline.view.TimelineView``."""

    @property
    def id(self) -> str:
        """Id, different for every motion."""
        ...

    @property
    def chain(self) -> Chain:
        """Chain that moves."""
        ...

    stretch: int | None
    """Straight modules that a camera keeps in view; all of them when None."""

    @property
    def growing(self) -> bool:
        """True while frames are still being added."""
        ...

    @property
    def error_scale_rad(self) -> float:
        """The joint error at which a module is fully red."""
        ...

    def __len__(self) -> int: ...

    def snapshot(self, frame: float) -> Snapshot:
        """Return the moment at a frame.

        Raises:
            TimelineError: When it is not there.
        """
        ...


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
        chain, motion = self.chain, self._motion
        one = motion.dense(chain, k, k + 1)
        poses = chain.poses(one.joint_angles_rad, one.root_position, one.root_wxyz)
        framed = len(chain)
        if motion.is_windowed and self.stretch is not None:
            framed = modules_framed(chain, int(motion.last[k]), self.stretch)
        return Snapshot(
            frame=float(k),
            time_s=float(one.time_s[0]),
            phase=PHASES[int(one.phase[0])],
            positions=poses.positions[0].astype(np.float32),
            wxyzs=poses.wxyzs[0].astype(np.float32),
            joint_angles_rad=one.joint_angles_rad[0],
            joint_error_rad=one.joint_error_rad[0],
            module_error_rad=chain_errors(chain, one.joint_error_rad[0]),
            framed=framed,
        )
