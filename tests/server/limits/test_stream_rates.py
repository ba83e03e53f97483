"""Stream rates: limits of the numbers that target streams send."""

import asyncio
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from foldback.server.api.trajectories import _TargetStream
from foldback.server.limits.networks import visitor_at
from foldback.server.target_streams.stream_messages import PlayOptions
from foldback.server.target_streams.stream_rates import NUMBERS_PER_SECOND_OF_VISITOR, stream_rates

JOINTS = 3


class Messages(list[str]):
    """Socket that stores what is sent."""

    async def send_text(self, text: str) -> None:
        self.append(text)


def trajectory() -> Any:
    """Return a trajectory in which nothing moves."""
    still = np.zeros((1, JOINTS))
    return SimpleNamespace(
        path=SimpleNamespace(frames=still),
        duration_s=100.0,
        joint_names=("a", "b", "c"),
        at=lambda _: (still, still, still),
        frame_at=lambda _: np.zeros(1),
    )


@pytest.mark.parametrize("speeds", [False, True])
def test_target_streams_of_a_visitor_get_a_limited_number_of_angles(speeds: bool) -> None:
    charged: list[int] = []

    def charge(numbers: int) -> float:
        charged.append(numbers)
        return 0.1

    async def speak() -> int:
        socket = Messages()
        namespace = cast("Any", SimpleNamespace(trajectory=trajectory()))
        options = PlayOptions(rate_hz=100, speeds=speeds)
        session = _TargetStream(cast("Any", socket), namespace, options, "fold", charge)
        session._at_start = True
        session._pace.report(0.0, asyncio.get_running_loop().time())
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(session._speak(), 0.65)
        return sum('"is":"target"' in text for text in socket)

    # One target in 0.1 s, instead of one in 0.01 s.
    assert 1 <= asyncio.run(speak()) <= 7
    assert set(charged) == {2 * JOINTS if speeds else JOINTS}


def test_robot_rates_leave_light_visitors_their_own() -> None:
    rates, numbers = stream_rates(), int(NUMBERS_PER_SECOND_OF_VISITOR)
    homes = [visitor_at(f"2001:db8:{k}::1") for k in range(8)]
    assert rates.charge(homes[0], numbers) == 0.0
    for home in homes:
        rates.charge(home, numbers)
        assert rates.charge(home, numbers) > 0.9
    assert rates.charge(visitor_at("203.0.113.7"), numbers // 100) == 0.0
    assert rates.charge(homes[0], 1) > 0.9
