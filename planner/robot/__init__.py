"""Robots: smoother motions, time stamps within joint limits, trajectories, motors and servos.

How a plan may be smoothed stands here, known without anything that smooths.
"""

from __future__ import annotations

from typing import Final

RECORDED_PLAN: Final = "recorded.npz"
"""In a smoothed fold's directory: the plan that is smoothed."""
SMOOTHED, SOFTENED, RECORDED = "smoothed", "softened", "recorded"
WAYS: Final = (SMOOTHED, SOFTENED, RECORDED)
"""Ways to smooth, each tried when the certificate refuses the one before: shortcuts and means,
fewer of them, and new times alone."""
MOST_ANGLES: Final = 2**23
"""Frames times hinges of a plan that may be smoothed."""
