"""Robots: smoother motions, time stamps within joint limits, trajectories, motors and servos.

The names of the ways to smooth a plan stand here, so that they are known without the smoothing.
"""

from __future__ import annotations

from typing import Final

RECORDED_PLAN: Final = "recorded.npz"
"""File name, in a smoothed fold's directory, of the plan that is smoothed."""
SMOOTHED, SOFTENED, RECORDED = "smoothed", "softened", "recorded"
SMOOTHING_WAYS: Final = (SMOOTHED, SOFTENED, RECORDED)
"""Kinds of smoothing, each tried if the certificate refuses the previous one: shortcuts and
averaging, fewer of them, and only new times."""
MAX_SMOOTHED_ANGLES: Final = 2**23
"""Maximum number of angles, frames times hinges, of a plan that is smoothed (memory and time).
Chosen."""
