"""Which folds the queue has room for."""

from __future__ import annotations

import pytest

from server.errors import TooMany
from server.limits.queue_room import Waiting, check_room
from server.settings import Settings

SETTINGS = Settings(
    largest_queue=12,
    largest_queue_of_visitor=4,
    largest_queue_seconds=1200.0,
    largest_queue_seconds_of_visitor=400.0,
)


def of(network: int, visitor: int, cost_s: float, count: int = 1) -> list[Waiting]:
    return count * [Waiting(f"2001:db8:{network}::/48|{visitor}", cost_s)]


@pytest.mark.parametrize(
    ("waiting", "wanted", "refused"),
    [
        ([], (0, 0, 1200.0), None),
        ([], (0, 0, 1300.0), "0 folds are waiting"),
        (of(0, 0, 300.0), (0, 0, 90.0), None),
        (of(0, 0, 300.0), (0, 0, 110.0), "your waiting folds"),
        (of(0, 0, 1.0, 4), (0, 0, 1.0), "4 of your folds"),
        # A network alone fills half of the queue, whoever its visitors are.
        (of(0, 0, 300.0) + of(0, 1, 200.0), (0, 2, 90.0), None),
        (of(0, 0, 300.0) + of(0, 1, 200.0), (0, 2, 210.0), "2 of them from your network"),
        (of(0, 0, 300.0) + of(0, 1, 300.0), (1, 0, 550.0), None),
        # The one that holds the most is refused first.
        (of(0, 0, 400.0) + of(1, 0, 100.0), (0, 1, 310.0), "network"),
        (of(0, 0, 400.0) + of(1, 0, 100.0), (1, 1, 310.0), None),
        (of(0, 0, 400.0) + of(1, 0, 400.0), (2, 0, 2.0), None),
        (of(0, 0, 1.0, 3) + of(0, 1, 1.0, 3), (0, 2, 1.0), "6 of them from your network"),
        (of(0, 0, 1.0, 3) + of(0, 1, 1.0, 3), (1, 0, 1.0), None),
    ],
)
def test_queue_room_is_shared_by_networks_and_visitors(
    waiting: list[Waiting], wanted: tuple[int, int, float], refused: str | None
) -> None:
    (fold,) = of(*wanted)
    if refused is None:
        check_room(waiting, fold, SETTINGS)
        return
    with pytest.raises(TooMany, match=refused) as error:
        check_room(waiting, fold, SETTINGS)
    assert error.value.code == "queue-full" and error.value.retry_after_s
