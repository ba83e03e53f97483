"""Targets: the simpler motions that a smoothing follows as far as they are clear."""

from __future__ import annotations

from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Flags, Ints

FADE_FRAMES: Final = 3
"""Half width, in frames, of the averaging filters by which the effect of smoothing fades in at the
start of a changed section of a motion, and out at its end; each takes about twice as many frames.
Measured from 2 to 4: clearances of 0.030 and 0.027 pitches instead of 0.029 (decision 0051)."""


def parts(frames: int, pieces: int, rng: np.random.Generator) -> Ints:
    """Return frames at which about ``pieces`` even parts of a motion begin, and its last frame."""
    inner = (np.arange(pieces) + rng.uniform(0.25, 0.75)) * (frames / pieces)
    return np.unique(np.concatenate([[0], inner.astype(np.int64), [frames - 1]]))


def straight(angles: Array, parts: Ints) -> Array:
    """Return (F, J) angles with all hinges running evenly from one part's start to the next."""
    return along(angles[parts], parts.astype(np.float64), np.arange(len(angles) * 1.0))


def direct(angles: Array) -> Array:
    """Return (F, J) angles that stay between those of the first and of the last frame.

    So a hinge that is straight in both stays straight.
    """
    ends = angles[[0, -1]]
    return np.clip(angles, ends.min(axis=0), ends.max(axis=0))


def mean(angles: Array, pieces: int) -> Array:
    """Return the (F, J) running mean over a part of the motion; the ends are kept."""
    from scipy.ndimage import uniform_filter1d  # late: most folds are not smoothed

    reach = max(1, len(angles) // (2 * pieces))
    half_reach = reach // 2
    pad = min(reach + half_reach, len(angles) - 1)
    before = 2.0 * angles[0] - angles[pad:0:-1]
    after = 2.0 * angles[-1] - angles[-2 : -pad - 2 : -1]
    # A corner of the first mean is a kink in the speed; of the second one, in the acceleration.
    mean = uniform_filter1d(np.concatenate([before, angles, after]), 2 * reach + 1, axis=0)
    mean = uniform_filter1d(mean, 2 * half_reach + 1, axis=0)[pad:-pad]
    mean[0], mean[-1] = angles[0], angles[-1]
    return mean


def worthwhile(costs: Array, new: Array, parts: Ints) -> Flags:
    """Return (F,), True for frames inside parts that would cost less."""
    better = np.add.reduceat(new, parts[:-1]) < np.add.reduceat(costs, parts[:-1])
    worth = np.repeat(better, np.diff(parts))
    return np.concatenate([[False], worth[1:] & worth[:-1], [False]])


def along(angles: Array, lengths: Array, places: Array) -> Array:
    """Return (P, J) configurations at (P,) lengths along (F, J) ones at (F,) lengths."""
    frame = np.clip(np.searchsorted(lengths, places, side="right") - 1, 0, len(lengths) - 2)
    span = lengths[frame + 1] - lengths[frame]
    part = np.where(span > 0.0, (places - lengths[frame]) / np.where(span > 0.0, span, 1.0), 1.0)
    samples = angles[frame] + part[:, None] * (angles[frame + 1] - angles[frame])
    samples[0], samples[-1] = angles[0], angles[-1]
    return samples


def softened(shares: Array) -> Array:
    """Return (F, J) shares that are nowhere larger, and change smoothly with time.

    They are 0 at both ends, which a motion keeps.
    """
    from scipy.ndimage import (
        minimum_filter1d,
        uniform_filter1d,
    )  # late: most folds are not smoothed

    low = np.pad(shares, ((FADE_FRAMES, FADE_FRAMES), (0, 0)))
    low = minimum_filter1d(low, 4 * FADE_FRAMES + 1, axis=0)
    for _ in range(2):
        low = uniform_filter1d(low, 2 * FADE_FRAMES + 1, axis=0)
    # A running sum leaves traces of what has passed.
    low = np.where(
        low[FADE_FRAMES:-FADE_FRAMES] < 1e-9,  # rounding errors of the running sums
        0.0,
        np.minimum(low[FADE_FRAMES:-FADE_FRAMES], shares),
    )
    low[0] = low[-1] = 0.0
    return low
