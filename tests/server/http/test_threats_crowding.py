"""What a few strangers do that others should wait for, and they do not."""

from __future__ import annotations

import signal
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from server.limits.token_buckets import TokenBuckets
from server.settings import Settings
from tests.server.http.test_bounds import from_address
from tests.server.service import Service

ServiceWith = Callable[..., Service]


def test_robots_whose_motions_are_not_worked_out_yet_hold_nobody_up(
    service: Service, finished: dict[str, Any]
) -> None:
    fold = finished["id"]
    play = f"ws://{service.http.base_url.netloc.decode()}/api/folds/{fold}/play"
    with connect(f"{play}?max_speed=0.5") as robot:
        robot.recv(timeout=60)  # the child that works them out is there
    (retimer,) = service.children("retimer")
    retimer.send_signal(signal.SIGSTOP)
    with ExitStack() as stack:
        robots = [
            stack.enter_context(
                connect(f"{play}?max_speed={1 + k}", additional_headers=from_address(f"10.8.{k}.1"))
            )
            for k in range(12)
        ]
        stack.callback(retimer.send_signal, signal.SIGCONT)
        for path in ("/health", f"/folds/{fold}", f"/folds/{fold}/bundle", f"/api/folds/{fold}"):
            assert service.http.get(path, timeout=20.0).status_code == 200
        retimer.send_signal(signal.SIGCONT)
        for robot in robots:
            assert '"begin"' in str(robot.recv(timeout=60))


def test_requests_have_a_rate(here_with: ServiceWith) -> None:
    service = here_with(requests_per_second_of_visitor=0.01, requests_at_once_of_visitor=3).start()
    own = from_address("2001:db8:1:2::1")
    answers = [service.http.get("/api/shapes", headers=own) for _ in range(4)]
    assert [answer.status_code for answer in answers] == [200, 200, 200, 429]
    refused = answers[-1]
    assert refused.json()["code"] == "too-many-requests"
    assert 0 < int(refused.headers["retry-after"]) <= 100
    assert refused.headers["x-content-type-options"] == "nosniff"
    same_network = from_address("2001:db8:1:2::ffff")
    assert service.http.get("/", headers=same_network).status_code == 429
    address = f"ws://{service.http.base_url.netloc.decode()}/api/folds/x/play"
    with pytest.raises(InvalidStatus), connect(address, additional_headers=own):
        pass
    assert service.http.get("/health", headers=own).status_code == 200
    assert service.http.get("/", headers=from_address("2001:db8:1:3::1")).status_code == 200


def test_a_bucket_fills_up_and_few_are_remembered() -> None:
    now = 0.0
    buckets = TokenBuckets(10.0, 5.0, most=3, clock=lambda: now)
    assert [buckets.take("a") for _ in range(6)] == [0.0] * 5 + [pytest.approx(0.1)]
    assert buckets.take("b") == 0.0
    now = 0.1
    assert buckets.take("a") == 0.0
    assert buckets.take("a") == pytest.approx(0.1)
    now = 60.0
    assert [buckets.take("a") for _ in range(6)] == [0.0] * 5 + [pytest.approx(0.1)]
    for visitor in "cdef":
        buckets.take(visitor)
    assert len(buckets) == 3


def test_no_few_addresses_have_all_streams() -> None:
    settings = Settings()
    assert 16 * settings.max_streams_of_visitor <= settings.max_streams
