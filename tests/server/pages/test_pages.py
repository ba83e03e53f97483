"""Pages that tell something, apart from any fold."""

from __future__ import annotations

import asyncio
import re

import httpx
from fastapi import FastAPI

from server.pages import benchmarks, static


def get(path: str) -> httpx.Response:
    app = FastAPI()
    app.include_router(benchmarks.router)
    app.include_router(static.router)

    async def ask() -> httpx.Response:
        transport = httpx.ASGITransport(app=app)
        async with httpx.AsyncClient(transport=transport, base_url="http://here") as client:
            return await client.get(path)

    return asyncio.run(ask())


def test_the_earlier_address_of_the_benchmarks_leads_to_them() -> None:
    moved = get("/what-folds")
    assert (moved.status_code, moved.headers["location"]) == (301, "/benchmarks")


def test_the_success_map_is_on_a_page_and_there() -> None:
    page = get("/benchmarks")
    assert page.status_code == 200
    assert 'aria-current="page"' in page.text
    (source,) = re.findall(r'<img src="([^"]+)"', page.text)
    drawn = get(source)
    assert drawn.headers["content-type"] == "image/svg+xml"
    for method in ("direct", "paper", "one-by-one", "simultaneous", "blocks", "peel", "auto"):
        assert f">{method}</text>" in drawn.text
        assert method in page.text
    assert "3 of 3 verified" in drawn.text
