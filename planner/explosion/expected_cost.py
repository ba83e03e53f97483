"""Expected cost: how long each strategy is likely to take until a chain is straight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

MEASURED_AT: Final = 512
"""Modules of the boxes whose explosions the seconds are of."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """What a strategy takes on one kind of path.

    Attributes:
        seconds: Processor seconds at ``MEASURED_AT`` modules.
        power: Of the number of modules, by which they grow.
        chance: Share of explosions that come straight.
    """

    seconds: float
    power: float
    chance: float

    def of(self, modules: int) -> float:
        """Processor seconds of one explosion."""
        return self.seconds * (modules / MEASURED_AT) ** self.power


IN_LAYERS: Final = {
    "simultaneous": Cost(seconds=1.0, power=2.4, chance=0.98),
    "peel": Cost(seconds=1.6, power=1.1, chance=0.98),
    "blocks": Cost(seconds=2.3, power=2.2, chance=0.95),
}
"""Of paths whose units can all leave along a line, as those in layers, from the chain's far end."""
INTERLOCKED: Final = {
    "simultaneous": Cost(seconds=3.0, power=2.0, chance=0.98),
    "peel": Cost(seconds=15.0, power=1.0, chance=0.3),
    "blocks": Cost(seconds=8.0, power=2.2, chance=0.5),
}
"""Of all others: around blocks, found by search, shaken up, or of a user's own making."""
MOST_S: Final = {"simultaneous": 600.0, "blocks": 120.0, "peel": float("inf")}
"""Processor seconds from which on a strategy is not tried."""


def by_cost(modules: int, *, in_layers: bool) -> tuple[str, ...]:
    """Strategies for a chain on the lattice, what is expected to take least until success first.

    A strategy that fails costs its time and brings nothing: seconds are divided by the chance.

    Args:
        modules: Of the chain.
        in_layers: Whether its path comes off unit by unit.
    """
    costs = IN_LAYERS if in_layers else INTERLOCKED
    fitting = {name: cost for name, cost in costs.items() if cost.of(modules) <= MOST_S[name]}
    return tuple(sorted(fitting, key=lambda name: costs[name].of(modules) / costs[name].chance))
