"""Security headers of all responses, and the origins that may call the service."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import httpx
import pytest
import websockets
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.http.security import AllowedHosts, SameOrigin, hosts_of
from tests.server.service import SNAKE, Service


def test_every_answer_carries_the_headers(desk: Service) -> None:
    for page in ("/", "/health", "/api/folds", "/api/openapi.json", "/nowhere"):
        headers = desk.http.get(page).headers
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["x-frame-options"] == "SAMEORIGIN"
        told = headers["content-security-policy"]
        policy = dict(part.split(" ", 1) for part in told.split("; "))
        assert "'unsafe-inline'" not in policy["script-src"]
        assert "'unsafe-eval'" not in policy["script-src"]
        assert "*" not in told
        assert policy["frame-ancestors"] == "'self'"
        assert "server" not in headers


def test_pages_of_others_change_nothing(desk: Service) -> None:
    def posted(origin: str) -> httpx.Response:
        form = {"shape": "mallet-64", "seed": "77"}
        return desk.http.post("/api/folds", data=form, headers={"Origin": origin})

    for origin in ("http://evil.example", "null", "http://[", f"ftp://{netloc(desk)}"):
        answer = posted(origin)
        assert (answer.status_code, answer.json()["code"]) == (403, "foreign-origin")
    answer = posted(f"http://{netloc(desk)}")
    assert (answer.status_code, answer.json()["existing"]) == (202, False)


def netloc(service: Service) -> str:
    return service.http.base_url.netloc.decode()


def test_websockets_of_others_are_refused(desk: Service) -> None:
    address = f"ws://{netloc(desk)}/api/folds/{desk.fold(SNAKE, seed='78')['id']}/play"

    async def status(origin: str) -> int:
        with pytest.raises(websockets.InvalidStatus) as refused:
            await websockets.connect(address, origin=websockets.Origin(origin))
        return refused.value.response.status_code

    assert asyncio.run(status("http://evil.example")) == 403
    assert asyncio.run(status(f"http://{netloc(desk)}")) == 409  # the fold is not ready


def test_other_names_do_not_lead_here(desk: Service) -> None:
    port = desk.http.base_url.port
    for host in (
        "evil.example",
        f"evil.example:{port}",
        "127.0.0.1.evil.example",
        "localhost.evil",
    ):
        # A page under that name would pass for one of ours.
        headers = {"Host": host, "Origin": f"http://{host}"}
        answer = desk.http.post("/api/folds", data={"shape": "mallet-64"}, headers=headers)
        assert (answer.status_code, answer.json()["code"]) == (400, "unknown-host")
        assert "FOLDBACK_ALLOWED_HOSTS" in answer.json()["detail"]
    for host in ("localhost", f"localhost:{port}", f"[::1]:{port}", f"127.0.0.1:{port}"):
        assert desk.http.get("/health", headers={"Host": host}).status_code == 200


def test_address_of_the_connection_leads_here_and_no_other_address() -> None:
    """Prometheus asks each web process by the address that it finds."""
    hosts = AllowedHosts(PlainTextResponse("here"), hosts=("fold.example.org",))

    async def status(host: str) -> int:
        async with httpx.AsyncClient(transport=httpx.ASGITransport(hosts)) as client:
            answer = await client.get("http://172.30.90.129:8000/", headers={"Host": host})
        return answer.status_code

    for host, expected in (
        ("172.30.90.129:8000", 200),
        ("fold.example.org", 200),
        ("172.30.90.130:8000", 400),
        ("172.30.90.129.evil.example", 400),
    ):
        assert asyncio.run(status(host)) == expected, host


Guard = Callable[[Scope, Receive, Send], Awaitable[None]]


def passed(guarding: Callable[[ASGIApp], Guard], headers: dict[str, str]) -> list[str]:
    """What a guard does with a WebSocket: lets it in, or what it sends instead."""
    done: list[str] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        done.append("in")

    async def receive() -> Message:
        return {"type": "websocket.connect"}

    async def send(message: Message) -> None:
        done.append(str(message["type"]))

    named = [(name.encode(), value.encode()) for name, value in headers.items()]
    asyncio.run(guarding(app)({"type": "websocket", "headers": named}, receive, send))
    return done


@pytest.mark.parametrize(
    ("listens", "allowed", "host", "answered"),
    [
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
    ],
)
def test_names_that_lead_here(
    listens: str, allowed: tuple[str, ...], host: str, answered: bool
) -> None:
    hosts = hosts_of(listens, allowed)
    done = passed(lambda app: AllowedHosts(app, hosts=hosts), {"host": host})
    assert done[0] == ("in" if answered else "websocket.http.response.start")


@pytest.mark.parametrize(
    ("origin", "host", "allowed"),
    [
        (None, "fold.example", True),
        ("https://fold.example", "fold.example", True),
        ("https://Fold.Example", "fold.example", True),
        ("https://fold.example:8443", "fold.example", False),
        ("https://fold.example.evil.example", "fold.example", False),
        ("https://partner.example", "fold.example", True),
        ("null", "fold.example", False),
        ("http://", "", False),
    ],
)
def test_origins_that_may_call(origin: str | None, host: str, allowed: bool) -> None:
    headers = {"host": host} | ({} if origin is None else {"origin": origin})
    done = passed(lambda app: SameOrigin(app, ["https://partner.example"]), headers)
    assert done[0] == ("in" if allowed else "websocket.http.response.start")
