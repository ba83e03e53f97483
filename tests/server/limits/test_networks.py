"""Networks: none can exhaust a quota or a rate by spreading over its addresses."""

import asyncio
import threading

import pytest

from foldback.server.errors import ServiceError, TooMany, Unavailable
from foldback.server.limits.concurrency_quota import Permit, Quota, network_share
from foldback.server.limits.networks import PSEUDONYM_SEPARATOR, hidden, networks_of, visitor_at
from foldback.server.limits.single_flight import SingleFlight
from foldback.server.limits.token_buckets import TokenBuckets

HOME = [visitor_at(f"2001:db8:1:{k}::1") for k in range(16)]
"""Visitors of one /56."""
SITE = [visitor_at(f"2001:db8:2:{k}00::1") for k in range(16)]
"""Visitors of one /48, each in a /56 of its own."""
STREET = [visitor_at(f"203.0.113.{k}") for k in range(16)]
"""Visitors of one /24."""
OTHER = visitor_at("198.51.100.1")


def fill(quota: Quota, visitors: list[str], ended: list[str] | None = None) -> list[Permit]:
    """Take as many permits as each visitor gets; ``ended`` receives the names of displaced ones."""
    permits: list[Permit] = []
    for visitor in visitors:
        end = None if ended is None else (lambda name=visitor: ended.append(name))
        try:
            while True:
                permits.append(quota.enter(visitor, end=end))
        except ServiceError:
            continue
    return permits


def test_quota_of_one_network_stops_at_half_the_total() -> None:
    for visitors in (HOME, SITE, STREET):
        quota = Quota("uploads", total=24, per_visitor=6)
        assert len(fill(quota, visitors)) == network_share(24, 6) == 12
        with pytest.raises(TooMany, match="from your network"):
            quota.enter(visitors[-1])
        assert quota.enter(OTHER)


def test_quota_when_full_displaces_the_network_that_holds_most() -> None:
    quota, ended = Quota("uploads", total=8, per_visitor=3), []
    fill(quota, [HOME[0], HOME[1], STREET[0], STREET[1]], ended)
    assert len(quota) == 8
    ended.clear()
    assert quota.enter(OTHER).held
    assert quota.enter(OTHER).held
    assert (len(quota), len(ended)) == (8, 2)
    assert {networks_of(name)[0] for name in ended} == {networks_of(HOME[0])[0], "203.0.113.0/24"}
    with pytest.raises(TooMany, match="in all"):  # displacing others would favour no network
        for _ in range(2):
            quota.enter(OTHER)


def test_quota_of_a_full_network_gives_its_own_visitors_a_share() -> None:
    quota, ended = Quota("uploads", total=12, per_visitor=6), []
    fill(quota, [STREET[0]], ended)
    assert quota.enter(STREET[1]).held
    assert (ended, len(quota)) == ([STREET[0]], 6)
    with pytest.raises(TooMany, match="of yours"):
        for _ in range(8):
            quota.enter(OTHER)


def test_quota_displaces_no_permit_without_end_and_no_operator() -> None:
    quota, ended = Quota("target streams", total=4, per_visitor=4), []
    quota.enter(None, end=lambda: ended.append("operator"))
    quota.enter(STREET[0])
    for _ in range(2):
        quota.enter(STREET[0])
    with pytest.raises(TooMany):
        quota.enter(OTHER)
    assert not ended


def test_quota_gives_turns_to_networks_before_visitors() -> None:
    started: list[str | None] = []
    quota = Quota("files", total=16, per_visitor=4, at_once=2, at_once_per_visitor=1)
    permits = [
        quota.enter(name, lambda permit: started.append(permit.visitor))
        for name in (*HOME[:4], STREET[0], OTHER)
    ]
    assert started == [HOME[0], STREET[0]]  # one network has only one of the two slots
    for k in (0, 4, 1):
        permits[k].leave()
    assert started[2:] == [HOME[1], OTHER, HOME[2]]  # networks alternate


def test_single_flight_refuses_those_displaced_by_another_network() -> None:
    async def ask() -> None:
        flight = SingleFlight("files", at_once=1, total=4, per_visitor=4)
        go_on = threading.Event()
        tasks = [
            asyncio.create_task(flight.get_or_make(k, lambda: go_on.wait(30.0), visitor=HOME[0]))
            for k in range(4)
        ]
        await asyncio.sleep(0)
        second = asyncio.create_task(flight.get_or_make("new", lambda: 1, visitor=OTHER))
        with pytest.raises(Unavailable):
            await tasks[3]
        go_on.set()
        assert await second == 1
        assert await asyncio.gather(*tasks[:3]) == [True] * 3
        flight.close()

    asyncio.run(ask())


def test_rate_of_one_network_is_twice_that_of_a_visitor() -> None:
    for visitors in (HOME, SITE, STREET):
        buckets = TokenBuckets(1.0, 10.0, clock=lambda: 0.0)
        assert sum(buckets.take(name) == 0.0 for name in visitors for _ in range(10)) == 20
        assert buckets.take(OTHER) == 0.0


def test_charge_of_more_than_there_is_makes_a_debt() -> None:
    now = 0.0
    buckets = TokenBuckets(10.0, 20.0, clock=lambda: now)
    assert buckets.charge("a", 20.0) == 0.0
    assert buckets.charge("a", 5.0) == pytest.approx(0.5)
    now = 0.5
    assert buckets.charge("a", 0.0) == pytest.approx(0.0)


def test_hidden_visitor_has_hidden_networks_and_fits_its_column() -> None:
    first, same_home, same_site = (hidden(name, b"secret") for name in (HOME[0], HOME[1], SITE[0]))
    assert networks_of(first) == networks_of(same_home)
    assert first != same_home
    assert networks_of(first)[0] != networks_of(same_site)[0]
    assert len(first) <= 64
    assert "2001" not in hidden(HOME[0], b"other") and hidden(HOME[0], b"other") != first
    assert networks_of(PSEUDONYM_SEPARATOR.join("abc")) == ("a", "a|b")


def test_ipv4_address_within_ipv6_is_the_ipv4_visitor() -> None:
    for text in ("::ffff:203.0.113.7", "64:ff9b::203.0.113.7", "2002:cb00:7107::1"):
        assert visitor_at(text) == visitor_at("203.0.113.7"), text
    # Other translators' prefixes and tunnels hold no address that can be trusted.
    assert visitor_at("64:ff9b:1::203.0.113.7").startswith("64:ff9b:1::/48")
