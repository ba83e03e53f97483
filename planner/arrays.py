"""Arrays: names for the types of NumPy arrays that most of the planner computes with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Numbers in double precision."""
Ints = NDArray[np.int64]
"""Indices and counts."""
Flags = NDArray[np.bool_]
"""Truth values."""
