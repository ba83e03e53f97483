"""Pages that tell something, apart from any fold: benchmarks, the paper's experiments, scripts."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import random
import re
from functools import cache
from html import unescape

import httpx
import pytest
from fastapi import FastAPI

from bench.reproduction.experiments import STATEMENTS
from server.http.compression import Asset
from server.pages import paper, same_for_all, static
from server.pages.page import script_addresses
from server.pages.static import IMMUTABLE_CACHE_CONTROL
from tests.server.service import SNAKE, Service, bearer
from web.static_files import VERSIONED, scripts_version
from web.timeline.columns import decode


@cache
def application() -> FastAPI:
    app = FastAPI()
    for page in (same_for_all, static, paper):
        app.include_router(page.router)
    return app


def get(path: str, **headers: str) -> httpx.Response:
    async def ask() -> httpx.Response:
        transport = httpx.ASGITransport(app=application())
        async with httpx.AsyncClient(transport=transport, base_url="http://here") as client:
            return await client.get(path, headers=headers)

    return asyncio.run(ask())


def test_earlier_address_of_the_benchmarks_redirects() -> None:
    moved = get("/what-folds")
    assert (moved.status_code, moved.headers["location"]) == (301, "/benchmarks")


def test_success_map_is_shown_on_the_benchmarks_page() -> None:
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


def test_scripts_and_styles_are_compressed_on_request() -> None:
    for path in ("/static/js/player/player.js", "/static/css/fold.css", "/static/success-map.svg"):
        plain = get(path, **{"Accept-Encoding": "identity"})
        packed = get(path, **{"Accept-Encoding": "br, gzip"})
        assert "content-encoding" not in plain.headers
        assert packed.headers["content-encoding"] == "gzip"
        assert packed.content == plain.content
        assert int(packed.headers["content-length"]) < 0.5 * len(plain.content)
        assert {each.headers["vary"] for each in (plain, packed)} == {"Accept-Encoding"}
        # Who keeps the one is not told that it is the other.
        tags = [each.headers["etag"] for each in (plain, packed)]
        assert tags[0] != tags[1]
        asked = {"Accept-Encoding": "gzip", "If-None-Match": tags[1]}
        assert get(path, **asked).status_code == 304
        assert get(path, **{**asked, "If-None-Match": tags[0]}).status_code == 200


def test_versioned_scripts_are_cached_by_browsers() -> None:
    address, *_ = script_addresses("fold")
    kept = get(address)
    assert kept.headers["cache-control"] == IMMUTABLE_CACHE_CONTROL
    earlier = get(address.replace(scripts_version(), "0123456789ab"))
    assert (earlier.content, earlier.headers["cache-control"]) == (kept.content, "no-cache")
    for name in ("css/fold.css", "js/no-such.js"):
        assert get(f"/static/{VERSIONED}/{scripts_version()}/{name}").status_code == 404


def test_incompressible_assets_are_sent_as_they_are() -> None:
    asset = Asset.of(random.Random(0).randbytes(4000), "image/webp")
    assert asset.packed is None
    assert Asset.of(b"x" * 4000, "text/css").packed is not None


def test_pages_with_secrets_are_not_compressed(desk: Service) -> None:
    fold = desk.fold(SNAKE, seed="301")
    own = {**bearer(fold["owner_token"]), "Accept-Encoding": "gzip"}
    for path in (
        f"/folds/{fold['id']}",
        f"/folds/{fold['id']}/facts",
        f"/api/folds/{fold['id']}",
        "/api/mine/folds",
        "/gallery?q=guess",
        f"/compare?a={fold['id']}&b={fold['id']}",
    ):
        answer = desk.http.get(path, headers=own)
        assert answer.status_code == 200, path
        assert "content-encoding" not in answer.headers, path
    same = [desk.http.get("/my-folds", headers=h) for h in (own, {"Accept-Encoding": "gzip"})]
    assert same[0].headers["content-encoding"] == "gzip"
    assert same[0].content == same[1].content


def test_only_the_theme_script_of_a_page_runs() -> None:
    page = get("/benchmarks")
    (script,) = re.findall(r"<script>(.*?)</script>", page.text, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    (policy,) = re.findall(r"script-src ([^;]+)", page.headers["Content-Security-Policy"])
    assert policy == f"'self' 'sha256-{digest}'"


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
