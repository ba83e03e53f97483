"""Queue room: limits of the queue, in total, per network and per visitor.

Each limit applies to the number of folds and to their expected computing time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

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
        reason = "{count} of your folds are waiting or running, which is the limit"
        raise _full(reason, count=len(own_costs_s))
    if (
        own_costs_s
        and sum(own_costs_s) + newcomer.cost_s > settings.largest_queue_seconds_of_visitor
    ):
        raise _full(
            "your waiting folds ({count}) take about {waiting_s:.0f} s, and this fold takes "
            "{fold_s:.0f} s. Together they may take at most {limit_s:g} s",
            count=len(own_costs_s),
            waiting_s=sum(own_costs_s),
            fold_s=newcomer.cost_s,
            limit_s=settings.largest_queue_seconds_of_visitor,
        )
    network = network_of(newcomer.visitor)
    near = [fold.cost_s for fold in waiting if network_of(fold.visitor) == network]
    all_s = sum(fold.cost_s for fold in waiting)
    if not (
        admits(len(near), 1, total=len(waiting), limit=settings.largest_queue)
        and admits(sum(near), newcomer.cost_s, total=all_s, limit=settings.largest_queue_seconds)
    ):
        raise _full(
            "{count} folds are waiting ({near} of them from your network). They take about "
            "{waiting_s:.0f} s, and this fold takes {fold_s:.0f} s. The queue holds at most "
            "{limit} folds, which may take {limit_s:g} s in total. One network may use at most "
            "half of the places and of the time that other networks do not use",
            count=len(waiting),
            near=len(near),
            waiting_s=all_s,
            fold_s=newcomer.cost_s,
            limit=settings.largest_queue,
            limit_s=settings.largest_queue_seconds,
        )


def _full(reason: str, **values: Any) -> TooMany:
    template = f"{reason}; try again in {{retry_after_s}} s."
    return TooMany("queue-full", template, retry_after_s=QUEUE_RETRY_S, **values)
