"""Smoothing: shorter and quieter motions of verified plans.

The names of the ways to smooth a plan stand here, so that they are known without the smoothing.
"""

from __future__ import annotations

from typing import Final

SMOOTHED, SOFTENED, RECORDED = "smoothed", "softened", "recorded"
SMOOTHING_WAYS: Final = (SMOOTHED, SOFTENED, RECORDED)
"""Kinds of smoothing, in the order in which they are tried until a certificate passes: shortcuts
and averages of the motion, fewer of them, and only a new timing along the recorded motion."""
MAX_SMOOTHED_ANGLES: Final = 2**23
"""Maximum number of hinge angles (frames × hinges) of a plan that is smoothed; longer plans stay as
they are."""
