"""Fronts of folded words and pictures, for tests."""

from __future__ import annotations

import numpy as np

from foldback.planner.pipeline.prepare import Preparation


def front(preparation: Preparation) -> list[str]:
    """Return the blocks of 2×2×2 modules, seen from the front, the top row first."""
    cells = preparation.cells // 2
    cells = cells - cells.min(axis=0)
    drawing = np.zeros(cells.max(axis=0)[[2, 0]] + 1, dtype=np.bool_)
    drawing[cells[:, 2], cells[:, 0]] = True
    return ["".join("#" if cell else "." for cell in row) for row in drawing[::-1]]
