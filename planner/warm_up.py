"""Warm-up: compiles the kernels into their cache, so that nobody waits for it later."""

from __future__ import annotations

from planner.folding import fold
from planner.paths import Path

SMALL_SHAPE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1), (1, 1, 1), (1, 0, 1)]


def warm_up() -> None:
    """Folds a tiny shape; takes seconds the first time and a moment ever after."""
    fold(Path.from_cells(SMALL_SHAPE, name="warm-up"))
