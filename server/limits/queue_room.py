"""Queue room: limits of the queue, in total, per network and per visitor.

Each limit applies to the number of folds and to their expected computing time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from foldback.server.errors import TooMany
from foldback.server.limits.fair_queue import admits, network_of
from foldback.server.settings import Settings

QUEUE_RETRY_S: Final = 30
"""Value of the ``Retry-After`` header, in s, if a fold is refused because the queue is full. A
smaller value brings more requests that are refused again."""


class Waiting(NamedTuple):
    """Queued or running fold, as counted by the limits of the queue.

    Attributes:
        visitor: Visitor that requested it.
        cost_s: Expected computing time, s.
    """

    visitor: str
    cost_s: float


def check_room(waiting: Sequence[Waiting], newcomer: Waiting, settings: Settings) -> None:
    """Refuse a fold for which the queue has no room.

    A visitor without folds in the queue may add one of any cost, if the queue has room for it.

    Raises:
        TooMany: If a limit is exceeded (``queue-full``).
    """
    own_costs_s = [fold.cost_s for fold in waiting if fold.visitor == newcomer.visitor]
    if len(own_costs_s) >= settings.largest_queue_of_visitor:
        raise _full(f"{len(own_costs_s)} of your folds are waiting or running, which is the limit")
    if (
        own_costs_s
        and sum(own_costs_s) + newcomer.cost_s > settings.largest_queue_seconds_of_visitor
    ):
        raise _full(
            f"your waiting folds ({len(own_costs_s)}) take about {sum(own_costs_s):.0f} s, and "
            "this fold takes "
            f"{newcomer.cost_s:.0f} s. Together they may take at most "
            f"{settings.largest_queue_seconds_of_visitor:g} s"
        )
    network = network_of(newcomer.visitor)
    near = [fold.cost_s for fold in waiting if network_of(fold.visitor) == network]
    all_s = sum(fold.cost_s for fold in waiting)
    if not (
        admits(len(near), 1, total=len(waiting), limit=settings.largest_queue)
        and admits(sum(near), newcomer.cost_s, total=all_s, limit=settings.largest_queue_seconds)
    ):
        raise _full(
            f"{len(waiting)} folds are waiting ({len(near)} of them from your network). They take "
            f"about {all_s:.0f} s, and this fold takes {newcomer.cost_s:.0f} s. The queue holds "
            f"at most {settings.largest_queue} folds, which may take "
            f"{settings.largest_queue_seconds:g} s in total. One network may use at most half of "
            "the places and of the time that other networks do not use"
        )


def _full(reason: str) -> TooMany:
    return TooMany(
        "queue-full",
        f"{reason}; try again in {QUEUE_RETRY_S} s.",
        retry_after_s=QUEUE_RETRY_S,
    )
