"""Strategy cost: how long each strategy is likely to take until a chain is straight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

COST_REFERENCE_MODULES: Final = 512
"""Number of modules of the box-shaped chains whose unfolding was timed: the costs in
``Cost.seconds`` are for this length and are scaled to other lengths by a power law. Measured."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """Cost model of one strategy on one kind of path.

    Attributes:
        seconds: Processor time of one explosion of ``COST_REFERENCE_MODULES`` modules, s.
        power: Exponent of the number of modules in that time.
        chance: Fraction of explosions that end straight, 0…1.
    """

    seconds: float
    power: float
    chance: float

    def of(self, modules: int) -> float:
        """Return the expected processor time of one explosion, s."""
        return self.seconds * (modules / COST_REFERENCE_MODULES) ** self.power


COSTS_IN_LAYERS: Final = {
    "simultaneous": Cost(seconds=1.0, power=2.4, chance=0.98),
    "peel": Cost(seconds=1.6, power=1.1, chance=0.98),
    "blocks": Cost(seconds=2.3, power=2.2, chance=0.95),
}
"""Expected cost of each unfolding strategy on paths that come apart easily: group by group, from
the chain's far end on, modules can leave the folded shape along a straight line. ``auto`` tries the
strategy with the lowest ``seconds`` (scaled to the chain's length) per ``chance`` of success first.
Measured."""
COSTS_INTERLOCKED: Final = {
    "simultaneous": Cost(seconds=3.0, power=2.0, chance=0.98),
    "peel": Cost(seconds=15.0, power=1.0, chance=0.3),
    "blocks": Cost(seconds=8.0, power=2.2, chance=0.5),
}
"""Expected cost of each unfolding strategy on all other paths, where some group of modules cannot
leave the folded shape along a straight line. ``auto`` tries the strategy with the lowest
``seconds`` (scaled to the chain's length) per ``chance`` of success first. Measured."""
MAX_STRATEGY_S: Final = {"simultaneous": 600.0, "blocks": 120.0, "peel": float("inf")}
"""Maximum expected processor time of an unfolding by strategy, s. ``auto`` does not try a strategy
that is expected to take longer."""


def by_cost(modules: int, *, in_layers: bool) -> tuple[str, ...]:
    """Sort the strategies for a chain on the lattice by expected time to success, least first.

    A strategy that fails costs its time and brings nothing: seconds are divided by the chance.

    Args:
        modules: Number of modules of the chain.
        in_layers: True if its path leaves the core unit by unit.
    """
    costs = COSTS_IN_LAYERS if in_layers else COSTS_INTERLOCKED
    fitting = {
        name: cost for name, cost in costs.items() if cost.of(modules) <= MAX_STRATEGY_S[name]
    }
    return tuple(sorted(fitting, key=lambda name: costs[name].of(modules) / costs[name].chance))
