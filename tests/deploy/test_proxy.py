"""deploy/Caddyfile in a real Caddy, in front of two web processes that share their folds."""

import contextlib
import json
from collections.abc import Iterator

import httpx
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from foldback.client import Client
from tests.deploy.proxy import Proxy, free_ports
from tests.server.service_process import SNAKE, STAIRS, Service

SETTINGS = {
    "workers": 0,
    "max_upload_bytes": 200_000,
    "max_streams_of_visitor": 1,
    "allowed_hosts": "localhost",
    "metrics_public": True,
}
pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def webs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[Service]]:
    data = tmp_path_factory.mktemp("behind") / "data"
    starts = [Service(data, port=port, **SETTINGS).start() for port in free_ports(2)]
    yield starts
    assert [service.stop() for service in starts] == [0, 0]


@pytest.fixture(scope="module")
def proxy(webs: list[Service], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Proxy]:
    addresses = [service.http.base_url for service in webs]
    made_proxy = Proxy(tmp_path_factory.mktemp("proxy"), *addresses, max_body="400KiB")
    yield made_proxy
    made_proxy.stop()


def test_pages_are_served_over_tls(proxy: Proxy) -> None:
    page = proxy.http.get("/")
    assert page.status_code == 200 and "foldback" in page.text
    assert proxy.http.get("/my-folds").headers["content-encoding"] == "gzip"  # by the service
    assert page.headers["strict-transport-security"].startswith("max-age=")
    assert "server" not in page.headers
    plain = httpx.get(f"http://localhost:{proxy.plain_port}/", follow_redirects=False)
    assert plain.status_code == 308 and plain.headers["location"].startswith("https://")


def test_answers_with_secrets_are_not_compressed(proxy: Proxy) -> None:
    own_headers = {"Authorization": f"Bearer {'k' * 24}", "Accept-Encoding": "gzip"}
    file = {"file": ("path.json", json.dumps(SNAKE))}
    accepted = proxy.http.post("/api/folds", files=file, headers=own_headers)
    page = f"/folds/{accepted.json()['id']}"
    answers = [accepted, *(proxy.http.get(p, headers=own_headers) for p in (page, f"/api{page}"))]
    answers += [
        proxy.http.get(path, headers=own_headers) for path in ("/api/mine/folds", "/gallery?q=x")
    ]
    for answer in answers:
        assert answer.is_success and "content-encoding" not in answer.headers, answer.url
        assert "no-transform" in answer.headers["cache-control"], answer.url


def test_events_are_streamed_unbuffered(proxy: Proxy) -> None:
    with Client(proxy.address, verify=proxy.tls) as client:
        fold = client.fold(SNAKE, seed=1)
        with proxy.http.stream("GET", f"/api/folds/{fold.id}/events") as stream:
            assert stream.headers["content-type"].startswith("text/event-stream")
            assert "content-encoding" not in stream.headers
            lines = stream.iter_lines()
            received = [line for line in (next(lines) for _ in range(2)) if line]
            # The first event arrives while the fold still waits; the others follow.
            assert received[0] == "event: progress" and '"queued"' in received[1]
            assert fold.cancel().status == "cancelled"
            response = "\n".join(lines)
    assert "event: done" in response and '"cancelled"' in response


def test_web_sockets_are_proxied(proxy: Proxy, webs: list[Service]) -> None:
    with webs[0].worker(), Client(proxy.address, verify=proxy.tls) as client:
        fold = client.fold(STAIRS, seed=2).wait()
    address = f"wss://localhost:{proxy.port}/api/folds/{fold.id}/play"
    for origin in (None, f"https://localhost:{proxy.port}"):
        with connect(address, ssl=proxy.tls, origin=origin) as socket:  # type: ignore[arg-type]
            assert json.loads(socket.recv(timeout=60))["is"] == "begin"
    with pytest.raises(InvalidStatus, match="403"):
        connect(address, ssl=proxy.tls, origin="https://evil.example")  # type: ignore[arg-type]


@pytest.mark.parametrize("size", [300_000, 5_000_000])
def test_large_bodies_are_refused(proxy: Proxy, size: int) -> None:
    answer = proxy.http.post("/api/folds", files={"file": ("large.stl", b"x" * size)})
    assert answer.status_code == 413
    # Within the proxy's limit, the service itself reports the error.
    assert (answer.headers.get("content-type") == "application/problem+json") == (size < 400_000)


def test_broken_requests_do_not_stop_the_service(proxy: Proxy) -> None:
    def endless() -> Iterator[bytes]:
        for _ in range(50):
            yield b"x" * 100_000

    for _ in range(4):  # enough requests to reach both web processes
        with contextlib.suppress(httpx.TransportError):
            proxy.http.post("/api/folds", content=endless())
    for _ in range(3):
        body = b"POST /api/folds HTTP/1.1\r\nHost: localhost\r\nContent-Length: 90000\r\n\r\nand"
        proxy.send_and_disconnect(body)
    answers = [proxy.http.get("/api/shapes") for _ in range(8)]
    assert [answer.status_code for answer in answers] == [200] * 8


@pytest.mark.parametrize("name", ["metrics", "ready"])
def test_operator_routes_are_closed_outside(proxy: Proxy, webs: list[Service], name: str) -> None:
    inside = webs[0].http.get(f"/{name}")
    assert inside.status_code in (200, 503) and inside.text
    ways = [
        f"/{name}",
        f"/{name}/",
        f"/{name}?a=b",
        f"//{name}",
        f"/./{name}",
        f"/api/../{name}",
        f"/%{ord(name[0]):02x}{name[1:]}",
        f"/%2e/{name}",
        f"/api%2f..%2f{name}",
        f"/{name.upper()}",
        f"https://localhost/{name}",
    ]
    for way in ways:
        answer = proxy.raw(way)
        status = int(answer.split(b" ", 2)[1])
        assert status in (400, 404) or 300 <= status < 400, (way, answer[:300])
        assert b"foldback_" not in answer and b'"database"' not in answer, way
    # No other host name is served.
    assert proxy.raw(f"http://127.0.0.1:8000/{name}").endswith(b"\r\n\r\n")
    assert proxy.raw("/health").startswith(b"HTTP/1.1 200")


def test_forwarded_addresses_of_visitors_are_ignored(proxy: Proxy, webs: list[Service]) -> None:
    with Client(proxy.address, verify=proxy.tls) as client:
        events = f"/api/folds/{client.fold(SNAKE, seed=3).id}/events"
    webs[1].stop()  # each process counts separately
    try:
        with proxy.client("127.0.0.1") as own_client, own_client.stream("GET", events) as first:
            assert first.status_code == 200
            for header in ("X-Forwarded-For", "X-Real-IP", "Forwarded", "X-Client-IP"):
                for forged in ("203.0.113.7", "203.0.113.7, 127.0.0.1", "for=203.0.113.7"):
                    with own_client.stream(
                        "GET", events, headers={header: forged}
                    ) as second_permit:
                        assert second_permit.status_code == 429, (header, forged)
            # The service distinguishes visitors: another one has its own limit.
            with (
                proxy.client("127.0.0.2") as other_client,
                other_client.stream("GET", events) as permit,
            ):
                assert permit.status_code == 200
    finally:
        webs[1].start()
