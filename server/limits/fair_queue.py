"""Turns: in which order folds that wait are computed, and how long that will take.

Self-clocked fair queueing (Golestani, INFOCOM 1994), with visitors as flows: a fold's turn is the
virtual time at which it would be over if all visitors who wait were served at the same rate. Who
asks for many folds waits for them behind those who ask for one, a short fold goes before a long
one, and nobody waits for ever, because virtual time goes on.
"""

from __future__ import annotations

from typing import Final

from planner.pathfinding.duration import expected_seconds
from planner.simulation.parameters import FLOATING

TICKS_A_SECOND: Final = 10
LATEST: Final = 2**31 - 2
"""Largest priority that the job system takes; at full load it is reached after years."""
SLOWEST: Final = 3600.0
CHANGED: Final = 4.0
"""Factor of the usual steps of a published explosion, with changed settings."""


def expected_s(
    modules: int,
    preset: str,
    settings: str = "",
    *,
    choosing: bool = False,
    world: str = FLOATING,
) -> float:
    """About how long a fold takes, as far as its turn depends on it.

    Args:
        modules: Of its chain.
        preset: Its parameters.
        settings: What it changes of them: such a fold may take all the steps that there are.
        choosing: Whether it chooses among several plans, which are all computed.
        world: Where it folds.
    """
    usual = expected_seconds(modules, preset, choosing=choosing, world=world)
    return min(SLOWEST, (CHANGED if settings else 1.0) * usual)


def ticks(cost_s: float) -> int:
    """Virtual time that a fold of some cost takes."""
    return max(1, round(TICKS_A_SECOND * cost_s))


def turn_of(*, now: int, last_own: int | None, cost_s: float, first: bool) -> int:
    """The turn of a fold that somebody asks for.

    Args:
        now: Virtual time, which is the latest turn that has come since nobody waited.
        last_own: The latest turn of the same visitor's folds that wait, if there are some.
        cost_s: What computing it is expected to take.
        first: Whether it goes before all others, as those of the gallery do.
    """
    if first:
        return now
    begin = now if last_own is None else max(now, last_own)
    return min(LATEST, begin + ticks(cost_s))


def wait_s(*, ahead_s: float, running_s: float, at_once: int) -> float | None:
    """About how long a fold waits; None when nobody computes.

    Args:
        ahead_s: What the folds before it take.
        running_s: What is left of those that are being computed.
        at_once: Folds that are computed at once.
    """
    return None if at_once == 0 else (ahead_s + running_s) / at_once
