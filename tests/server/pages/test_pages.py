"""Pages about several folds or none: benchmarks, the paper's experiments, scripts."""

import base64
import hashlib
import json
import random
import re
from functools import cache
from html import unescape

import httpx
import pytest
from fastapi import FastAPI

from bench.reproduction.experiments import STATEMENTS
from bench.stored_sweeps import MAP_NAMES
from foldback.planner.parameters.settings_text import SETTINGS
from foldback.planner.readers.formats import READABLE_SUFFIXES
from foldback.server.http.downloads import Asset
from foldback.server.pages import paper, prerendered_pages, static
from foldback.server.pages.page import script_addresses
from foldback.server.pages.static import IMMUTABLE_CACHE_CONTROL
from foldback.web.static_files import VERSIONED, scripts_version
from tests.server.asgi import send_request
from tests.server.service_process import SNAKE, Service, bearer
from tests.web.timeline.decoding import decode


@cache
def application() -> FastAPI:
    app = FastAPI()
    for page in (prerendered_pages, static, paper):
        app.include_router(page.router)
    return app


def get(path: str, **headers: str) -> httpx.Response:
    return send_request(application(), path, headers=headers)


def test_success_map_is_shown_on_the_benchmarks_page() -> None:
    page = get("/benchmarks")
    assert 'aria-current="page"' in page.text
    (source,) = re.findall(r'<img src="([^"]+)"', page.text)
    drawn = get(source)
    assert drawn.headers["content-type"] == "image/svg+xml"
    for method in MAP_NAMES["method"].values():
        assert f">{method}</text>" in drawn.text
        assert method in page.text


def test_dialogs_offer_all_files_that_can_be_read(idle: Service) -> None:
    for page in ("/", "/shapes/new"):
        assert f'accept="{",".join(READABLE_SUFFIXES)}"' in idle.http.get(page).text


def test_scripts_and_styles_are_compressed_on_request() -> None:
    for path in ("/static/js/player/player.js", "/static/css/fold.css", "/static/success-map.svg"):
        plain = get(path, **{"Accept-Encoding": "identity"})
        packed = get(path, **{"Accept-Encoding": "br, gzip"})
        assert "content-encoding" not in plain.headers
        assert packed.headers["content-encoding"] == "gzip"
        assert packed.content == plain.content
        assert int(packed.headers["content-length"]) < 0.5 * len(plain.content)
        assert {page.headers["vary"] for page in (plain, packed)} == {"Accept-Encoding"}
        # Caches distinguish the two.
        tags = [page.headers["etag"] for page in (plain, packed)]
        assert tags[0] != tags[1]
        for tag, status in zip(tags, (200, 304), strict=True):
            expected = get(path, **{"Accept-Encoding": "gzip", "If-None-Match": tag})
            assert expected.status_code == status


def test_versioned_scripts_are_cached_by_browsers() -> None:
    address, *_ = script_addresses("fold")
    repeated = get(address)
    assert repeated.headers["cache-control"] == IMMUTABLE_CACHE_CONTROL
    earlier = get(address.replace(scripts_version(), "0123456789ab"))
    assert (earlier.content, earlier.headers["cache-control"]) == (repeated.content, "no-cache")
    for name in ("css/fold.css", "js/no-such.js"):
        assert get(f"/static/{VERSIONED}/{scripts_version()}/{name}").status_code == 404


def test_incompressible_assets_are_sent_unchanged() -> None:
    assert Asset.of(random.Random(0).randbytes(4000), "image/webp").packed is None
    assert Asset.of(b"x" * 4000, "text/css").packed is not None


def test_pages_with_secrets_are_not_compressed(idle: Service) -> None:
    fold = idle.fold(SNAKE, seed="301")
    page, fold_id = f"/folds/{fold['id']}", fold["id"]
    own_headers = {**bearer(fold["owner_token"]), "Accept-Encoding": "gzip"}
    paths = (page, f"{page}/facts", f"/api{page}", "/api/mine/folds", "/gallery?q=guess")
    for path in (*paths, f"/compare?a={fold_id}&b={fold_id}"):
        answer = idle.http.get(path, headers=own_headers)
        assert answer.status_code == 200, path
        assert "content-encoding" not in answer.headers, path
        assert "no-transform" in answer.headers["cache-control"], path
    accepted = idle.upload("path.json", json.dumps(SNAKE), token="k" * 24)
    assert "no-transform" in accepted.headers["cache-control"]  # it holds the token


def test_my_folds_page_is_the_same_for_all_and_not_indexed(idle: Service) -> None:
    keys = (bearer("K" * 32), {})
    same_https = [
        idle.http.get("/my-folds", headers=key | {"Accept-Encoding": "gzip"}) for key in keys
    ]
    assert same_https[0].content == same_https[1].content
    for page in same_https:
        assert page.headers["content-encoding"] == "gzip"
        assert page.headers["cache-control"] == "no-store"
        assert "noindex" in page.headers["x-robots-tag"]


def test_only_the_theme_script_of_a_page_runs() -> None:
    page = get("/benchmarks")
    (script,) = re.findall(r"<script>(.*?)</script>", page.text, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    (policy,) = re.findall(r"script-src ([^;]+)", page.headers["Content-Security-Policy"])
    assert policy == f"'self' 'sha256-{digest}'"


@pytest.mark.slow
def test_every_statement_is_shown_and_every_address_is_answered() -> None:
    page = get("/paper")
    text = unescape(page.text)
    for statement in STATEMENTS:
        assert statement.quote in text and f'id="{statement.id}"' in text
    stills = set(re.findall(r'<img src="([^"]+)"', page.text))
    films = set(re.findall(r'data-timeline="([^"]+)"', page.text))
    assert stills and films
    for still in stills:
        answer = get(still)
        assert answer.headers["content-type"] == "image/webp" and len(answer.content) > 500
    for film in films:
        chain = decode(get(f"{film}/bundle").content)[0]["chain"]
        batch, columns = decode(get(f"{film}/batch").content)
        assert batch["total"] == len(columns["time_s"]) > 10
        joints = chain["hinges"] * (chain["modules"] - 1 - chain["rigid_links"])
        assert columns["joint_angles_rad"].shape[1] == joints


def test_settings_of_the_paper_are_sent_to_pages_that_have_none() -> None:
    assert get("/paper/settings").text.count("data-setting") == len(SETTINGS)


def test_films_are_cached_until_they_change() -> None:
    first = get("/paper/mallet-24/batch")
    repeated_get = get("/paper/mallet-24/batch", **{"if-none-match": first.headers["etag"]})
    assert (repeated_get.status_code, repeated_get.content) == (304, b"")


def test_no_address_leads_to_another_file() -> None:
    odd = ("mallet-24/..%2f..%2fpage.json", "..%2f..%2fserver/app.py", "%2e%2e/page.json")
    for path in (*odd, "nosuch/batch", "mallet-24/nosuch", "mallet-24/chain.json"):
        assert get(f"/paper/{path}").status_code == 404, path
