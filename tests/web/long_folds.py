"""Timelines of long folds for pages: windows made by kinematics, uneven as real ones are."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from planner.chain.chain import Chain
from planner.motion.motion import PHASES, Motion
from planner.motion.timeline import TimelineWriter
from tests.planner import peels


def fold(
    chain: Chain, *, width: int, step: float, base_moves: bool = False, off: float = 0.0
) -> Motion:
    """A chain straightened and folded again, at random a little beside the even way.

    With ``off`` its playback was simulated: that is the size of the joint errors.
    """
    rng = np.random.default_rng(7)
    there = peels.peel(chain, width=width, step=step)
    noise = rng.normal(0.0, 0.01, len(there.angles_rad)).astype(np.float32)
    there = dataclasses.replace(there, angles_rad=there.angles_rad + noise)
    if base_moves:
        turns = there.anchor_wxyz + rng.normal(0.0, 0.05, there.anchor_wxyz.shape)
        there = there.with_columns(
            base_position=there.anchor_position + rng.normal(0.0, 0.1, there.anchor_position.shape),
            base_wxyz=turns / np.linalg.norm(turns, axis=1, keepdims=True),
        )
    back = dataclasses.replace(
        there[np.arange(len(there))[::-1]],
        time_s=there.time_s[-1] + 1.0 + there.time_s,
        phase=np.full(len(there), PHASES.index("playback"), np.uint8),
    )
    if off:
        errors = np.abs(rng.normal(0.0, off, len(back.angles_rad))).astype(np.float32)
        back = dataclasses.replace(back, errors_rad=errors)
    return Motion.joined([there, back])


def write(path: Path, chain: Chain, windows: Motion) -> Path:
    """A complete timeline of them."""
    with TimelineWriter.create(path, chain, windowed=True) as writer:
        for start in range(0, len(windows), 512):
            writer.append(windows[start : start + 512])
    return path
