"""Fair queue: the order in which folds are computed, and which of them are accepted.

Self-clocked fair queueing (Golestani, INFOCOM 1994): a fold's turn is the virtual time at which it
would be over if all waiting networks were served at the same rate, and within a network all its
visitors. A visitor's many folds wait behind the single folds of others, short folds go before long
ones, and no fold waits forever, because virtual time advances.

Each worker has separate slots for two lanes, so that quick folds never wait for long ones. A fold
whose time slice is over is paused for others (``server.jobs.slices``).

The queue is divided by dynamic thresholds (Choudhury and Hahne, IEEE/ACM ToN 1998): a network may
hold no more than is still free. One network alone fills half of the queue, two fill a third each,
and the one that holds the most is refused first.
"""

from __future__ import annotations

from typing import Final

from foldback.server.limits.networks import networks_of

QUICK_FOLD_S: Final = 10.0
"""Maximum expected computing time of a fold in the queue for quick folds, in s. Half of the shapes
of fewer than 300 modules are quick."""


def ticks(cost_s: float) -> int:
    """Return the expected cost of a fold in ticks of virtual time."""
    return max(1, round(10 * cost_s))  # tenths of a second


def is_quick(cost_s: float) -> bool:
    """Return True if a fold of this expected cost is computed in the lane for quick folds."""
    return cost_s <= QUICK_FOLD_S


def slice_s(cost_s: float, pauses: int, first_s: float, *, for_cheaper: bool = False) -> float:
    """Return the seconds for which a fold computes before it is paused for waiting folds.

    Args:
        cost_s: Expected cost of the fold.
        pauses: Number of times that it has been paused before.
        first_s: Length of the first slice before a pause for cheaper folds, s.
        for_cheaper: True for a pause for cheaper folds; False for any.
    """
    whole_s = max(first_s / 3.0, 3.0 * cost_s)
    # so that pauses waste at most half of the work since the last one
    return min(whole_s, first_s * 3.0**pauses) if for_cheaper else whole_s


def network_of(visitor: str) -> str:
    """Return the widest network around a visitor; the visitor if none is known."""
    return (*networks_of(visitor), visitor)[0]


def admits(held_s: float, cost_s: float, *, total: float, limit: float) -> bool:
    """Return True if a network may hold more of a queue.

    Args:
        held_s: Amount that the network holds, in folds or in seconds.
        cost_s: Amount that it requests.
        total: Amount that all networks hold.
        limit: Size of the queue. All four have the same unit.
    """
    return held_s + cost_s <= limit - total


def virtual_finish_time(
    *, now: int, last_own: int | None, cost_s: float, sharers: int = 1, first: bool = False
) -> int:
    """Return the turn of a fold.

    Args:
        now: Virtual time: the latest turn that was reached since the queue was last empty.
        last_own: Latest turn of the visitor's waiting folds; None if there are none.
        cost_s: Expected cost of the fold.
        sharers: Number of waiting visitors in the visitor's network, including the visitor.
        first: True if the fold goes before all others, such as a gallery fold.
    """
    if first:
        return now
    start = now if last_own is None else max(now, last_own)
    # fits into 32 bits; at full load it takes years
    return min(2**31 - 2, start + ticks(cost_s * sharers))


def wait_s(*, ahead_s: float, running_s: float, at_once: int) -> float | None:
    """Return the estimated wait of a fold in s; None if there is no worker.

    Args:
        ahead_s: Expected cost of the folds before it, s.
        running_s: Remaining cost of running folds, s.
        at_once: Number of folds that are computed at once.
    """
    return None if at_once == 0 else (ahead_s + running_s) / at_once
