"""Forwarded addresses: what is no address counts as the proxy that reports it."""

import httpx
import pytest
from fastapi import FastAPI, Request

from foldback.server.http.client_address import address_of
from foldback.server.http.forwarded_address import MAX_PROXIES, ForwardedAddress
from foldback.server.limits.networks import visitor_at
from tests.server.asgi import send_request

PROXY = visitor_at("127.0.0.1")  # the client of httpx.ASGITransport


def visitor(*forwarded: str) -> str:
    """Return the visitor for whom a request counts, by its header fields X-Forwarded-For."""
    app = FastAPI()

    @app.get("/")
    async def client(request: Request) -> str:
        return address_of(request)

    app.add_middleware(ForwardedAddress, proxies=("127.0.0.0/8", "::1"))
    headers = httpx.Headers([("X-Forwarded-For", value) for value in forwarded])
    return send_request(app, "/", headers=headers).json()


@pytest.mark.parametrize(
    "text",
    [
        *("x1", "unknown", "_hidden", "-", "203.0.113.00148", "203.0.113.7:x", "203.0.113"),
        *("203.0.113.7.9", "0x7f.1", "1", "203.0.113.7/24", "[2001:db8::1", "2001:db8::1]", ""),
        *(" ", ",", "::ffff:1.2.3", "%eth0", "203.0.113.7, x", "x" * 8000, "for=203.0.113.7"),
    ],
)
def test_text_that_is_no_address_counts_as_its_proxy(text: str) -> None:
    assert visitor(text) == PROXY


def test_every_form_of_an_address_is_one_visitor() -> None:
    four, six = visitor_at("203.0.113.7"), visitor_at("2001:db8::1")
    for text in ("203.0.113.7", "203.0.113.7:49152", " 203.0.113.7 ", "::ffff:203.0.113.7"):
        assert visitor(text) == four
    for text in ("2001:db8::1", "[2001:db8::1]", "[2001:DB8:0::1]:443", "2001:db8::1%1"):
        assert visitor(text) == six
    assert visitor("198.51.100.1, 203.0.113.7, 127.0.0.1") == four
    assert visitor("198.51.100.1", "203.0.113.7") == four
    assert visitor() == PROXY


def test_few_addresses_of_a_long_list_are_read() -> None:
    def trusted(count: int) -> str:
        return ",".join(["203.0.113.7", *(f"127.0.0.{k}" for k in range(count))])

    assert visitor(trusted(MAX_PROXIES - 1)) == visitor_at("203.0.113.7")
    assert visitor(trusted(MAX_PROXIES)) == visitor_at("127.0.0.0")
