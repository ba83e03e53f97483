"""Motion quality: figures of a plan's motion, apart from its verification."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.certificate.motion_figures import MotionFigures
from foldback.planner.chain.chain import Chain
from foldback.planner.plan.plan import Plan
from foldback.planner.playback.reference_curve import record_lengths
from foldback.planner.smoothing.smoothing import DISTANCE_WEIGHT

TAIL_CHUNK_FRAMES: Final = 64
"""Number of frames whose poses are computed at once, to measure how far the chain's ends travel."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Quality:
    """Figures of a plan's motion. Speeds and torques are those of a fold that takes a given time.

    Attributes:
        frames: Number of frames.
        fold_time_s: Time that it takes at the certificate's bound of joint speed.
        length_rad: Arc length of the motion, see
            ``planner.playback.reference_curve.record_lengths``.
        travel_ratio: Travel of all hinges relative to the least possible, see ``MotionFigures``;
            None if hardly anything has to move.
        reversals_mean: Mean number of changes of direction of a hinge, see ``MotionFigures``.
        hinges_moving_mean, hinges_moving_most: Number of hinges that move at the same time.
        peak_speed_rad_s: Largest speed of a hinge.
        peak_torque_nm: Largest torque of a hinge, floating, without gravity.
        tail_way: Path length of that end of the chain which goes farther, pitches; the centre of
            mass and the root's orientation are held still.
        tail_speed: Largest speed of an end, pitches/s.
        clearance: Least clearance at the certificate's module size, pitches.
    """

    frames: int
    fold_time_s: float
    length_rad: float
    travel_ratio: float | None
    reversals_mean: float
    hinges_moving_mean: float
    hinges_moving_most: int
    peak_speed_rad_s: float
    peak_torque_nm: float
    tail_way: float
    tail_speed: float
    clearance: float

    @classmethod
    def of(cls, plan: Plan, seconds: float) -> Quality:
        """Compute the quality of a plan with a playback, if it takes ``seconds``."""
        certificate = plan.certificate
        assert certificate.fold_time_s is not None
        assert certificate.peak_torque_nm is not None
        assert certificate.hinges_moving_mean is not None
        assert certificate.hinges_moving_most is not None
        assert certificate.min_clearance is not None
        angles = plan.joint_angles_rad
        hinges = MotionFigures.of(plan.chain, plan.motion)
        assert hinges is not None, "plans of so many frames are not smoothed"
        times = plan.time_s * (seconds / max(float(plan.time_s[-1]), 1e-12))
        ways = _tail_ways(plan.chain, angles)
        moments = np.maximum(np.diff(times), 1e-12)[:, None]
        return cls(
            frames=len(angles),
            fold_time_s=certificate.fold_time_s,
            length_rad=float(record_lengths(plan.chain, angles, DISTANCE_WEIGHT)[-1]),
            travel_ratio=hinges.travel_ratio,
            reversals_mean=hinges.reversals_mean,
            hinges_moving_mean=certificate.hinges_moving_mean,
            hinges_moving_most=certificate.hinges_moving_most,
            peak_speed_rad_s=certificate.joint_speed_limit_rad_s
            * certificate.fold_time_s
            / seconds,
            peak_torque_nm=certificate.peak_torque_nm * (certificate.fold_time_s / seconds) ** 2,
            tail_way=float(ways.sum(axis=0).max()),
            tail_speed=float((ways / moments).max()),
            clearance=certificate.min_clearance,
        )

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        return asdict(self)


def _tail_ways(chain: Chain, angles: Array) -> Array:
    """Return the (F − 1, 2) distances of both ends from frame to frame, pitches."""
    ways: list[Array] = []
    origin, upright = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    for start in range(0, len(angles) - 1, TAIL_CHUNK_FRAMES):
        centres = chain.poses(
            angles[start : start + TAIL_CHUNK_FRAMES + 1], origin, upright
        ).positions
        ends = centres[:, [0, -1]] - centres.mean(axis=1, keepdims=True)
        ways.append(np.linalg.norm(np.diff(ends, axis=0), axis=2))
    return np.concatenate(ways)
