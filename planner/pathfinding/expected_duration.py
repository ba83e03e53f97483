"""Expected duration: an estimate of how long a fold will take, from its number of modules."""

from __future__ import annotations

from typing import Final

from foldback.planner.chain.module import LONG_CHAIN
from foldback.planner.parameters.parameters import FLOATING

MAX_IMPROVING_S: Final = 300.0
"""Maximum time, in s, that the duration that users are told before a fold is longer if several
plans are computed and the best is chosen, rather than the first."""


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
        below, beyond = 3.5, 2.0
        share = modules / 96  # the longest chain that was timed
        # measured: docs/decisions/0026
        return 1.0 + 330.0 * share ** (below if share < 1.0 else beyond)
    if choosing:
        plain = expected_seconds(modules, preset)
        return min(8.0 * plain, plain + MAX_IMPROVING_S)  # measured
    if preset == "paper":
        return 12.0 + 0.36 * modules
    if modules > LONG_CHAIN:
        return 2.0 + 0.012 * modules
    return 1.0 + 0.006 * modules + 1.4 * (modules / 160.0) ** 2.6


def smoothing_seconds(modules: int) -> float:
    """Estimate the duration of smoothing a motion, s, without playback and certificate.

    Measured: docs/decisions/0016-smoothing.md.
    """
    return 2.0 + 0.03 * modules
