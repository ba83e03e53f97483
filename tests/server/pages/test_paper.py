"""The page of the paper's experiments, and the films and stills in it."""

from __future__ import annotations

import asyncio
import re
from functools import cache
from html import unescape

import httpx
import pytest
from fastapi import FastAPI

from bench.reproduction.experiments import STATEMENTS
from server.pages import paper, static
from web.timeline.columns import decode


@cache
def application() -> FastAPI:
    app = FastAPI()
    app.include_router(static.router)
    app.include_router(paper.router)
    return app


def get(path: str, **headers: str) -> httpx.Response:
    async def ask() -> httpx.Response:
        transport = httpx.ASGITransport(app=application())
        async with httpx.AsyncClient(transport=transport, base_url="http://here") as client:
            return await client.get(path, headers=headers)

    return asyncio.run(ask())


@pytest.mark.slow
def test_every_statement_is_shown_and_every_address_is_answered() -> None:
    page = get("/paper")
    assert page.status_code == 200
    text = unescape(page.text)
    for statement in STATEMENTS:
        assert statement.quote in text and f'id="{statement.id}"' in text
    for name in ("Radial force gain λ", "Damping", "not in the paper"):
        assert name in text
    stills = set(re.findall(r'<img src="([^"]+)"', page.text))
    films = set(re.findall(r'data-timeline="([^"]+)"', page.text))
    assert stills and films
    for still in stills:
        answer = get(still)
        assert answer.headers["content-type"] == "image/webp" and len(answer.content) > 500
    for film in films:
        bundle, _ = decode(get(f"{film}/bundle").content)
        batch, columns = decode(get(f"{film}/batch").content)
        assert batch["total"] == len(columns["time_s"]) > 10
        assert columns["joint_angles_rad"].shape[1] == bundle["chain"]["hinges"] * (
            bundle["chain"]["modules"] - 1 - bundle["chain"]["rigid_links"]
        )


def test_films_are_cached_until_they_change() -> None:
    first = get("/paper/mallet-24/batch")
    again = get("/paper/mallet-24/batch", **{"if-none-match": first.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


@pytest.mark.parametrize(
    "path",
    ["nosuch/batch", "mallet-24/nosuch", "mallet-24/chain.json", "..%2f..%2fserver/app.py"]
    + ["mallet-24/..%2f..%2fpage.json", "%2e%2e/page.json"],
)
def test_no_address_leads_to_another_file(path: str) -> None:
    assert get(f"/paper/{path}").status_code == 404
