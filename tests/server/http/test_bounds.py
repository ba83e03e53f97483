"""Limits for one visitor, and the responses beyond them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import httpx
import pytest
from starlette.requests import HTTPConnection

from server.http.client_address import address_of
from tests.server.service import SNAKE, Service

ServiceWith = Callable[..., Service]


def from_address(address: str) -> dict[str, str]:
    """What a proxy in front of the service says of a visitor."""
    return {"X-Forwarded-For": address}


@pytest.mark.parametrize(
    ("settings", "second", "whose"),
    [
        ({"max_streams_of_visitor": 1}, "203.0.113.1", "of yours"),
        ({"max_streams": 1}, "203.0.113.2", "in all"),
    ],
)
def test_event_streams_are_bounded(
    here_with: ServiceWith, settings: dict[str, int], second: str, whose: str
) -> None:
    service = here_with(**settings).start()
    address = f"/api/folds/{service.fold(SNAKE)['id']}/events"

    def follow(visitor: str) -> contextlib.AbstractContextManager[httpx.Response]:
        return service.http.stream("GET", address, headers=from_address(visitor))

    service.http.timeout = 20.0
    with follow("203.0.113.1") as open_stream:
        lines = open_stream.iter_lines()  # held, for httpx hangs up when it is thrown away
        assert next(lines) == "event: progress"
        with follow(second) as refused:
            assert refused.status_code == 429
            refused.read()
            assert refused.headers["content-type"] == "application/problem+json"
            assert int(refused.headers["retry-after"]) > 0
            assert refused.json()["code"] == "too-many-streams"
            assert whose in refused.json()["detail"]
    for _ in range(600):  # once the service has noticed that the first one left
        with follow(second) as again:
            if again.status_code == 200:
                return
    raise AssertionError("the place of a stream that ended is not given back")


@pytest.mark.parametrize(
    ("host", "address"),
    [
        ("203.0.113.7", "203.0.113.0/24|203.0.113.7"),
        ("::ffff:203.0.113.7", "203.0.113.0/24|203.0.113.7"),
        ("2001:db8:1:2ff:3:4:5:6", "2001:db8:1::/48|2001:db8:1:200::/56|2001:db8:1:2ff::/64"),
        ("fe80::1%eth0", "fe80::/48|fe80::/56|fe80::/64"),
        ("testclient", "testclient"),
        ("a|b", "ab"),
    ],
)
def test_addresses_of_one_visitor_are_one(host: str, address: str) -> None:
    assert address_of(HTTPConnection({"type": "http", "client": (host, 1)})) == address
