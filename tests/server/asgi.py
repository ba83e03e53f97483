"""Requests to an application in this process, without a server."""

import asyncio
from typing import Any

import httpx
from starlette.types import ASGIApp


def send_request(
    app: ASGIApp, path: str, *, method: str = "GET", base_url: str = "http://here", **extra: Any
) -> httpx.Response:
    """Return the answer to one request; ``extra`` contains further arguments for httpx."""

    async def ask() -> httpx.Response:
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url=base_url) as client:
            return await client.request(method, path, **extra)

    return asyncio.run(ask())
