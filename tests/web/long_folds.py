"""Timelines of long folds for pages: windows made by kinematics, uneven as real ones are."""

import dataclasses
from pathlib import Path

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.motion.motion import PHASES, Motion
from foldback.planner.motion.timeline import TimelineWriter
from tests.planner import peels


def fold(
    chain: Chain, *, width: int, step: float, base_moves: bool = False, error_rad: float = 0.0
) -> Motion:
    """Return a motion that straightens and folds a chain again, with small random deviations.

    With ``error_rad`` the playback counts as simulated: it is the size of the joint errors, rad.
    """
    rng = np.random.default_rng(7)
    out = peels.peel(chain, width=width, step=step)
    noise = rng.normal(0.0, 0.01, len(out.angles_rad)).astype(np.float32)
    out = dataclasses.replace(out, angles_rad=out.angles_rad + noise)
    if base_moves:
        turns = out.anchor_wxyz + rng.normal(0.0, 0.05, out.anchor_wxyz.shape)
        out = out.with_columns(
            base_position=out.anchor_position + rng.normal(0.0, 0.1, out.anchor_position.shape),
            base_wxyz=turns / np.linalg.norm(turns, axis=1, keepdims=True),
        )
    changed = dataclasses.replace(
        out[np.arange(len(out))[::-1]],
        time_s=out.time_s[-1] + 1.0 + out.time_s,
        phase=np.full(len(out), PHASES.index("playback"), np.uint8),
    )
    if error_rad:
        errors = np.abs(rng.normal(0.0, error_rad, len(changed.angles_rad))).astype(np.float32)
        changed = dataclasses.replace(changed, errors_rad=errors)
    return Motion.joined([out, changed])


def write(path: Path, chain: Chain, windows: Motion) -> Path:
    """Write a complete timeline of windows."""
    with TimelineWriter.create(path, chain, windowed=True) as writer:
        for start in range(0, len(windows), 512):
            writer.append(windows[start : start + 512])
    return path
