"""Security headers of all responses, and the origins that may call the service."""

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial

import pytest
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from websockets import InvalidStatus, Origin
from websockets.sync.client import connect

from foldback.server.http.security import AllowedHosts, SameOrigin, hosts_of
from tests.server.asgi import send_request
from tests.server.service_process import SNAKE, Service, check_problem


def test_every_answer_carries_the_headers(idle: Service) -> None:
    for page in ("/", "/health", "/api/folds", "/api/openapi.json", "/nowhere"):
        headers = idle.http.get(page).headers
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["x-frame-options"] == "SAMEORIGIN"
        value = headers["content-security-policy"]
        policy = dict(part.split(" ", 1) for part in value.split("; "))
        assert "'unsafe-" not in policy["script-src"] and "*" not in value
        assert policy["frame-ancestors"] == "'self'"
        assert "server" not in headers


def test_pages_of_others_change_nothing(idle: Service) -> None:
    form, host = {"shape": "mallet-64", "seed": "77"}, idle.netloc
    for method, path in (
        ("POST", "/api/folds"),
        ("PATCH", "/api/folds/x"),
        ("DELETE", "/api/folds/x"),
        ("DELETE", "/api/mine/previews/x"),
    ):
        for origin in ("http://evil.example", "null", "http://[", f"ftp://{host}"):
            answer = idle.http.request(method, path, data=form, headers={"Origin": origin})
            assert (answer.status_code, answer.json()["code"]) == (403, "foreign-origin")
    own_answer = idle.http.post("/api/folds", data=form, headers={"Origin": f"http://{host}"})
    assert (own_answer.status_code, own_answer.json()["existing"]) == (202, False)
    # A browser that has no permission may not even send one of our keys in a header.
    send_request = {"Origin": "http://evil.example", "Access-Control-Request-Method": "GET"}
    send_request["Access-Control-Request-Headers"] = "authorization"
    answer = idle.http.options("/api/mine/folds", headers=send_request)
    assert not [name for name in answer.headers if name.startswith("access-control")]


def test_websockets_of_others_are_refused(idle: Service) -> None:
    address = f"ws://{idle.netloc}/api/folds/{idle.fold(SNAKE, seed='78')['id']}/play"
    # 409: the fold is not ready.
    for origin, status in (("http://evil.example", 403), (f"http://{idle.netloc}", 409)):
        with pytest.raises(InvalidStatus) as refused, connect(address, origin=Origin(origin)):
            pass
        assert refused.value.response.status_code == status


def test_other_host_names_are_refused(idle: Service) -> None:
    port = idle.http.base_url.port
    for host in ("evil.example", f"evil.example:{port}", "127.0.0.1.evil.example"):
        # A page under that name could pass for one of ours.
        headers = {"Host": host, "Origin": f"http://{host}"}
        answer = idle.http.post("/api/folds", data={"shape": "mallet-64"}, headers=headers)
        assert "FOLDBACK_ALLOWED_HOSTS" in check_problem(answer, 400, "unknown-host")
    for host in ("localhost", f"localhost:{port}", f"[::1]:{port}", f"127.0.0.1:{port}"):
        assert idle.http.get("/health", headers={"Host": host}).status_code == 200


def test_only_the_address_of_the_connection_is_accepted_as_host() -> None:
    """Prometheus requests each web process by the address that it finds."""
    hosts = AllowedHosts(PlainTextResponse("here"), hosts=("fold.example.org",))

    for host, status in (
        ("172.30.90.129:8000", 200),
        ("fold.example.org", 200),
        ("172.30.90.130:8000", 400),
        ("172.30.90.129.evil.example", 400),
    ):
        answer = send_request(hosts, "http://172.30.90.129:8000/", headers={"Host": host})
        assert answer.status_code == status, host


Guard = Callable[[Scope, Receive, Send], Awaitable[None]]


def accepted(guarding: Callable[[ASGIApp], Guard], headers: dict[str, str]) -> bool:
    """Return True if a guard accepts a WebSocket."""
    done: list[str] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        done.append("in")

    async def receive() -> Message:
        return {"type": "websocket.connect"}

    async def send(message: Message) -> None:
        done.append(str(message["type"]))

    named = [(name.encode(), value.encode()) for name, value in headers.items()]
    asyncio.run(guarding(app)({"type": "websocket", "headers": named}, receive, send))
    assert done[0] in ("in", "websocket.http.response.start")
    return done[0] == "in"


def test_accepted_host_names() -> None:
    for listens, allowed, host, answered in (
        ("127.0.0.1", (), "localhost:8000", True),
        ("127.0.0.1", (), "evil.example", False),
        ("127.0.0.2", (), "127.0.0.2:1", True),
        ("::1", (), "[::1]:8000", True),
        ("0.0.0.0", (), "anything.example", True),
        ("192.0.2.1", (), "fold.example", True),
        ("0.0.0.0", ("fold.example",), "evil.example", False),
        ("192.0.2.1", ("fold.example",), "192.0.2.1", True),
        ("127.0.0.1", ("fold.example",), "Fold.Example:8000", True),
        ("127.0.0.1", ("*.school.example",), "a.school.example", True),
        ("127.0.0.1", ("*.school.example",), "school.example", False),
        ("127.0.0.1", ("*",), "evil.example", True),
    ):
        guard = partial(AllowedHosts, hosts=hosts_of(listens, allowed))
        assert accepted(guard, {"host": host}) == answered, (listens, allowed, host)


def test_origins_that_may_call() -> None:
    guard = partial(SameOrigin, origins=["https://partner.example"])
    assert accepted(guard, {"host": "fold.example"})
    for origin, host, allowed in (
        ("https://Fold.Example", "fold.example", True),
        ("https://fold.example:8443", "fold.example", False),
        ("https://fold.example.evil.example", "fold.example", False),
        ("https://partner.example", "fold.example", True),
        ("null", "fold.example", False),
        ("http://", "", False),
    ):
        assert accepted(guard, {"host": host, "origin": origin}) == allowed, origin


def test_long_addresses_are_refused(idle: Service) -> None:
    """Decoding 30 kB of query takes ten times as long as the rest of a request."""
    for address in ("/robots.txt?" + "a&" * 70, "/gallery?q=" + "x" * 9000, "/" + "a/" * 5000):
        check_problem(idle.http.get(address), 400, "bad-address")
    assert idle.http.get("/robots.txt?" + "a=%41&" * 60).status_code == 200
