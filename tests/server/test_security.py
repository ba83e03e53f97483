"""What every answer says to browsers, and whose pages may talk to the service."""

from __future__ import annotations

import asyncio

import pytest
import websockets

from server.security import SameOrigin
from tests.server.service import SNAKE, Service


@pytest.mark.parametrize("page", ["/", "/health", "/api/folds", "/api/openapi.json", "/nowhere"])
def test_every_answer_carries_the_headers(desk: Service, page: str) -> None:
    headers = desk.http.get(page).headers
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["x-frame-options"] == "SAMEORIGIN"
    policy = dict(part.split(" ", 1) for part in headers["content-security-policy"].split("; "))
    assert "'unsafe-inline'" not in policy["script-src"]
    assert "'unsafe-eval'" not in policy["script-src"]
    assert "*" not in headers["content-security-policy"]
    assert policy["frame-ancestors"] == "'self'"
    assert "server" not in headers


def test_pages_of_others_change_nothing(desk: Service) -> None:
    for origin in (
        "http://evil.example",
        "null",
        "http://[",
        "ftp://" + desk.http.base_url.netloc.decode(),
    ):
        answer = desk.http.post(
            "/api/folds", data={"shape": "mallet-64", "seed": "77"}, headers={"Origin": origin}
        )
        assert (answer.status_code, answer.json()["code"]) == (403, "foreign-origin")
    own = str(desk.http.base_url).rstrip("/")
    answer = desk.http.post(
        "/api/folds", data={"shape": "mallet-64", "seed": "77"}, headers={"Origin": own}
    )
    assert answer.status_code == 202
    assert not answer.json()["existing"]


def test_websockets_of_others_are_refused(desk: Service) -> None:
    fold_id = desk.fold(SNAKE, seed="78")["id"]
    address = f"ws://{desk.http.base_url.netloc.decode()}/folds/{fold_id}/control/{'v' * 24}"

    async def opens(origin: str) -> bool:
        try:
            async with websockets.connect(address, origin=websockets.Origin(origin)) as socket:
                await asyncio.wait_for(socket.recv(), 30)
        except (websockets.InvalidStatus, websockets.ConnectionClosed):
            return False
        return True

    assert not asyncio.run(opens("http://evil.example"))
    assert asyncio.run(opens(str(desk.http.base_url).rstrip("/")))


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
def test_origins(origin: str | None, host: str, allowed: bool) -> None:
    passed: list[str] = []

    async def app(scope, receive, send) -> None:
        passed.append("in")

    async def receive() -> dict[str, object]:
        return {"type": "websocket.connect"}

    async def send(message: dict[str, object]) -> None:
        passed.append(str(message["type"]))

    headers = [(b"host", host.encode())]
    if origin is not None:
        headers.append((b"origin", origin.encode()))
    guard = SameOrigin(app, ["https://partner.example"])
    asyncio.run(guard({"type": "websocket", "headers": headers}, receive, send))
    assert passed == (["in"] if allowed else ["websocket.close"])
