"""NPZ: the plan's arrays for NumPy, with all else as JSON text."""

from __future__ import annotations

from io import BytesIO

import numpy as np

from planner.plan.plan import Plan


def write(plan: Plan) -> bytes:
    """The arrays that ``Plan.save_npz`` writes; needs no pickle to read."""
    file = BytesIO()
    np.savez_compressed(file, **plan.npz_arrays())
    return file.getvalue()
