"""Limits per visitor: requests from a few addresses do not delay those of others."""

import contextlib
import signal
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest
from starlette.requests import HTTPConnection
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from foldback.server.http.client_address import address_of
from foldback.server.limits.token_buckets import TokenBuckets
from foldback.server.settings import Settings
from tests.server.files.test_damage import service_with_shipped_fold
from tests.server.http.test_threats_uploads import connect_to, status_of
from tests.server.service_process import SNAKE, FinishedFold, Service, check_problem
from tests.server.service_thread import ServiceWith


def test_target_streams_that_wait_for_their_motion_hold_up_no_others(
    finished: FinishedFold,
) -> None:
    fold = finished.id
    play = f"ws://{finished.service.netloc}/api/folds/{fold}/play"
    with connect(f"{play}?max_speed=0.5") as client:
        client.recv(timeout=60)  # the child that computes them runs
    (retimer,) = finished.service.children("retimer")
    retimer.send_signal(signal.SIGSTOP)
    with ExitStack() as stack:
        stack.callback(retimer.send_signal, signal.SIGCONT)
        for k in range(6):
            visitor = from_address(f"10.8.{k}.1")
            client = connect(f"{play}?max_speed={1 + k}", additional_headers=visitor)
            stack.enter_context(client)
        for path in ("/health", f"/folds/{fold}", f"/folds/{fold}/bundle", f"/api/folds/{fold}"):
            assert finished.http.get(path, timeout=20.0).status_code == 200
        retimer.send_signal(signal.SIGCONT)
        assert '"begin"' in str(client.recv(timeout=60))


def test_websocket_holds_its_connection_until_it_is_closed(tmp_path: Path) -> None:
    visitors = {"trusted_proxies": "192.0.2.0/24", "max_connections_of_visitor": 2}
    with service_with_shipped_fold(tmp_path, **visitors) as service, ExitStack() as stack:
        for _ in range(2):  # 127.0.0.1 is no trusted proxy here
            assert is_open(stack.enter_context(connect_to(service)), shipped_id(service))
        assert status_of(stack.enter_context(connect_to(service)), b"/api/shapes") == 503
        assert status_of(stack.enter_context(connect_to(service)), b"/health") == 200


def shipped_id(service: Service) -> str:
    """Return the id of the only fold, without a connection to the service."""
    (directory,) = service.directory(".").iterdir()
    return directory.name


def test_refused_websocket_is_closed_whatever_its_peer_does(idle: Service) -> None:
    with connect_to(idle) as client:
        assert not is_open(client, "aaaaaaaaaaaaaaaaaaaa")
        data = b""
        while piece := client.recv(65536):
            data += piece
        assert data.endswith(b"}")  # the problem is complete, then the connection ends


def test_pings_are_limited_by_a_rate(tmp_path: Path) -> None:
    with (
        service_with_shipped_fold(tmp_path, requests_per_second_of_visitor=1) as service,
        connect_to(service) as client,
    ):
        assert is_open(client, shipped_id(service))
        client.sendall(b"\x89\x80\0\0\0\0" * 3000)
        for k in range(8):
            address = from_address(f"10.{k}.0.1")
            assert service.http.get("/api/shapes", headers=address).status_code == 200
        client.setblocking(False)
        pongs = client.recv(65536).count(b"\x8a\x00")
    assert 0 < pongs < 1500


def is_open(client: socket.socket, fold_id: str) -> bool:
    """Return True if the service accepts a WebSocket from a client that never closes one."""
    client.sendall(
        b"GET /api/folds/%b/play HTTP/1.1\r\nHost: localhost\r\nX-Forwarded-For: 203.0.113.1\r\n"
        b"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n" % fold_id.encode()
    )
    status = b""
    while len(status) < len(b"HTTP/1.1 101"):
        status += client.recv(len(b"HTTP/1.1 101") - len(status))
    return status.endswith(b"101")


def test_requests_are_limited_by_a_rate(service_with: ServiceWith) -> None:
    service = service_with(
        requests_per_second_of_visitor=0.01, requests_at_once_of_visitor=3
    ).start()
    own_address = from_address("2001:db8:1:2::1")
    answers = [service.http.get("/api/shapes", headers=own_address) for _ in range(4)]
    assert [answer.status_code for answer in answers] == [200, 200, 200, 429]
    refused = answers[-1]
    check_problem(refused, 429, "too-many-requests", retry=True)
    assert int(refused.headers["retry-after"]) <= 100
    assert refused.headers["x-content-type-options"] == "nosniff"
    address = f"ws://{service.netloc}/api/folds/x/play"
    with pytest.raises(InvalidStatus), connect(address, additional_headers=own_address):
        pass
    for path, visitor, status in (
        ("/", "2001:db8:1:2::ffff", 429),  # same network as an earlier visitor
        ("/", "2001:db8:1:3::1", 200),
        ("/health", "2001:db8:1:2::1", 200),
    ):
        assert service.http.get(path, headers=from_address(visitor)).status_code == status


def test_token_buckets_refill_and_few_are_remembered() -> None:
    now = 0.0
    buckets = TokenBuckets(10.0, 5.0, max_buckets=3, clock=lambda: now)
    assert [buckets.take("a") for _ in range(6)] == [0.0] * 5 + [pytest.approx(0.1)]
    now = 60.0
    assert [buckets.take("a") for _ in range(6)] == [0.0] * 5 + [pytest.approx(0.1)]
    now = 60.1
    assert [buckets.take("a") for _ in range(2)] == [0.0, pytest.approx(0.1)]
    assert buckets.take("b") == 0.0
    for visitor in "cdef":
        buckets.take(visitor)
    assert len(buckets) == 3


def test_few_addresses_cannot_take_all_streams() -> None:
    settings = Settings()
    assert 16 * settings.max_streams_of_visitor <= settings.max_streams


def from_address(address: str) -> dict[str, str]:
    """Return the headers by which a proxy in front of the service reports a visitor."""
    return {"X-Forwarded-For": address}


def test_event_streams_are_bounded(service_with: ServiceWith) -> None:
    service = service_with(max_streams=2, max_streams_of_visitor=1).start()
    address = f"/api/folds/{service.fold(SNAKE)['id']}/events"

    def follow(visitor: str) -> contextlib.AbstractContextManager[httpx.Response]:
        return service.http.stream("GET", address, headers=from_address(visitor))

    service.http.timeout = 20.0
    with ExitStack() as stack:
        lines: list[Iterator[str]] = []  # keep references, as httpx closes deleted responses
        for visitor in ("203.0.113.1", "198.51.100.1"):
            lines.append(stack.enter_context(follow(visitor)).iter_lines())
            assert next(lines[-1]) == "event: progress"
        for visitor, whose in (("203.0.113.1", "of yours"), ("192.0.2.1", "in all")):
            with follow(visitor) as refused:
                refused.read()
                assert whose in check_problem(refused, 429, "too-many-event-streams", retry=True)
    for _ in range(600):  # until the service notices that the first ones are closed
        with follow("203.0.113.1") as second_follow:
            if second_follow.status_code == 200:
                return
    raise AssertionError("the place of a stream that ended is not given back")


def test_addresses_of_one_visitor_are_one() -> None:
    for host, address in (
        ("203.0.113.7", "203.0.113.0/24|203.0.113.7"),
        ("::ffff:203.0.113.7", "203.0.113.0/24|203.0.113.7"),
        ("2001:db8:1:2ff:3:4:5:6", "2001:db8:1::/48|2001:db8:1:200::/56|2001:db8:1:2ff::/64"),
        ("fe80::1%eth0", "fe80::/48|fe80::/56|fe80::/64"),
        ("testclient", "testclient"),
        ("a|b", "ab"),
    ):
        assert address_of(HTTPConnection({"type": "http", "client": (host, 1)})) == address
