"""Expected duration: an estimate of how long a fold will take, from its number of modules."""

from __future__ import annotations

from typing import Final

from foldback.planner.chain.module import LONG_CHAIN
from foldback.planner.parameters.parameters import FLOATING

CHOICE_FACTOR: Final = 8.0
"""Duration of a fold that computes several plans and chooses the best, relative to one that takes
the first plan, by which the duration is estimated that users are told before a fold. Measured."""
MAX_IMPROVING_S: Final = 300.0
"""Maximum time, in s, that the duration that users are told before a fold is longer if several
plans are computed and the best is chosen, rather than the first."""

TABLE_MODULES: Final = 96
"""Number of modules of the longest chain whose fold on a table was timed. The expected duration of
a fold on a table grows with the power 3.5 of the number of modules up to this number, and with its
square beyond."""
TABLE_S: Final = 330.0
"""Expected duration of a fold of 96 modules on a table, in s of processor time; durations for other
numbers of modules are scaled from it. Measured: 6 minutes, and 8 for 88 modules with a second
attempt (decision 0026)."""
TABLE_POWERS: Final = (3.5, 2.0)
"""Exponents of the number of modules in the expected duration of a fold on a table. The first holds
up to 96 modules; fitted to 2 s for 24 modules and 29 to 62 s for 64. The second holds beyond, where
attempts get stuck and end early."""


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
