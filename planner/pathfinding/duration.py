"""Duration: an estimate of how long a fold will take, from its number of modules."""

from __future__ import annotations

from typing import Final

from planner.chain.module import LONG_CHAIN
from planner.parameters.parameters import FLOATING

CHOICE_FACTOR: Final = 8.0
"""Ratio of the durations of a fold that chooses among plans and of a single one. Measured."""
MAX_IMPROVING_S: Final = 300.0
"""Maximum additional duration of a fold that chooses among plans. Chosen."""

TABLE_MODULES: Final = 96
"""Number of modules at which ``TABLE_S`` was measured and the growth changes."""
TABLE_S: Final = 330.0
"""Duration of a fold of ``TABLE_MODULES`` modules on a table. Measured: 6 minutes, and 8 for 88
with a second attempt (docs/decisions/0026-tables.md)."""
TABLE_POWERS: Final = (3.5, 2.0)
"""Powers of the number of modules with which that time grows: up to ``TABLE_MODULES``, fitted to
2 s of 24 modules and 29 to 62 s of 64, and beyond, where attempts end because they get stuck."""


def expected_seconds(
    modules: int, preset: str = "default", *, choosing: bool = False, world: str = FLOATING
) -> float:
    """Estimate the duration of a fold on two cores, s, from runs of 24 to 9600 modules.

    The published preset was measured with 64 to 192 modules: 39 s to 88 s.

    Args:
        modules: Number of modules of the chain.
        preset: Name of the parameters' preset.
        choosing: True if the fold chooses among plans, see ``planner.pipeline.improvements``.
        world: World of the fold; on a table runs of 24 to 96 modules were measured.
    """
    if world != FLOATING:
        below, beyond = TABLE_POWERS
        share = modules / TABLE_MODULES
        return 1.0 + TABLE_S * share ** (below if share < 1.0 else beyond)
    if choosing:
        plain = expected_seconds(modules, preset)
        return min(CHOICE_FACTOR * plain, plain + MAX_IMPROVING_S)
    if preset == "paper":
        return 12.0 + 0.36 * modules
    if modules > LONG_CHAIN:
        return 2.0 + 0.012 * modules
    return 1.0 + 0.006 * modules + 1.4 * (modules / 160.0) ** 2.6
