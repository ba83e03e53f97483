"""Arrays: names for the types of NumPy arrays that most of the planner computes with."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Numbers in double precision."""
Ints = NDArray[np.int64]
"""Indices and counts."""
Flags = NDArray[np.bool_]
"""Truth values."""
FRAMES_AT_ONCE: Final = 256
"""Number of frames of a motion that are computed at once where memory for all would be too much; it
does not change results."""
