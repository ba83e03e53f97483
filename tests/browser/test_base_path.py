"""A service below a path of a host, behind a real proxy that has other things beside it."""

from __future__ import annotations

import os
import re
import subprocess
import time
from collections.abc import Iterator
from contextlib import closing

import httpx
import pytest
from playwright.sync_api import Browser, expect
from websockets.sync.client import connect

from foldback_client import Client
from tests.browser.conftest import LOOK
from tests.deploy.proxy import free_ports
from tests.server.service import PATIENCE_S, Service
from tests.tools import CADDY

pytestmark = pytest.mark.long
BASE = "/fold"
CADDYFILE = """{{
  admin off
}}
http://127.0.0.1:{port} {{
  handle {base}/* {{
    reverse_proxy {upstream}
  }}
  respond "not foldback" 404
}}
"""
ADDRESSES = """() => [...document.querySelectorAll("[href], [src], [action], [data-timeline]")]
  .map((each) => each.getAttribute("href") ?? each.getAttribute("src")
    ?? each.getAttribute("action") ?? each.dataset.timeline)
  .filter((address) => address.startsWith("/"))"""


@pytest.fixture(scope="module")
def below(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a service below a path of a proxy."""
    place = tmp_path_factory.mktemp("below")
    service = Service(place / "data", base_path=BASE, workers=0, finished_folds=True).start()
    (port,) = free_ports(1)
    file = place / "Caddyfile"
    upstream = f"127.0.0.1:{service.http.base_url.port}"
    file.write_text(CADDYFILE.format(port=port, base=BASE, upstream=upstream))
    command = [CADDY.get(), "run", "--config", str(file), "--adapter", "caddyfile"]
    environment = {"PATH": os.environ["PATH"], "HOME": str(place)}
    with open(place / "caddy.log", "w") as log:
        proxy = subprocess.Popen(command, env=environment, stderr=log, stdout=log)
    host = f"http://127.0.0.1:{port}"
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            if httpx.get(f"{host}{BASE}/health").is_success:
                break
        except httpx.TransportError:
            assert time.monotonic() < deadline, (place / "caddy.log").read_text()
        time.sleep(0.05)
    yield host + BASE
    proxy.terminate()
    proxy.wait(PATIENCE_S)
    assert service.stop() == 0


@pytest.fixture(scope="module")
def fold(below: str) -> str:
    """The id of a finished fold."""
    with Client(below) as client:
        return min(client.folds(), key=lambda each: each.refresh().id).id


def test_pages_below_a_path_ask_for_nothing_beside_it(
    below: str, fold: str, browser: Browser
) -> None:
    page = browser.new_page(**LOOK)
    wrong: list[str] = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("response", lambda answer: wrong.append(answer.url) if answer.status >= 400 else None)
    fine = re.compile(rf"(blob:|data:|{re.escape(below)}/)")
    page.on("request", lambda asked: None if fine.match(asked.url) else wrong.append(asked.url))
    for path in ("/", "/gallery", "/paper", "/benchmarks", "/docs", "/my-folds", "/shapes/new"):
        page.goto(below + path, wait_until="networkidle")
        assert [one for one in page.evaluate(ADDRESSES) if not one.startswith(f"{BASE}/")] == []
    for path in (f"/embed/{fold}", f"/compare?a={fold}&b={fold}", f"/folds/{fold}"):
        page.goto(below + path)
        expect(page.locator("#scrub")).to_be_enabled()
        page.locator("#play").click()
        page.wait_for_function("() => +document.getElementById('scrub').value > 0")
    page.locator("#sketch.gone").wait_for(state="attached")  # the 3D view has come
    page.locator("#details").click()
    page.locator("#tab-downloads").click()
    links = page.locator("#panel-downloads .downloads a")
    for href in links.evaluate_all("(all) => all.map((one) => one.href)"):
        assert httpx.head(href).is_success, href
    assert page.locator('meta[property="og:image"]').get_attribute("content") == (
        f"{below}/folds/{fold}/picture.png"
    )
    assert wrong == []
    page.close()


def test_redirects_sockets_and_programs_work_below_a_path(below: str, fold: str) -> None:
    with httpx.Client() as http:
        assert http.get(f"{below}/what-folds").headers["location"] == f"{BASE}/benchmarks"
        assert http.get(f"{below}/gallery/").headers["location"] == f"{below}/gallery"
        assert http.get(below.removesuffix(BASE) + "/gallery").text == "not foldback"
        described = http.get(f"{below}/oembed", params={"url": f"{below}/folds/{fold}"}).json()
        assert described["thumbnail_url"] == f"{below}/folds/{fold}/picture.png"
        icons = http.get(f"{below}/manifest.webmanifest").json()["icons"]
        assert all(http.get(f"{below}/{icon['src']}").is_success for icon in icons)
        assert http.get(f"{below}/api/openapi.json").json()["servers"] == [{"url": BASE}]
    with Client(below) as client:
        assert client.get(fold).verified
    with closing(connect(f"ws{below.removeprefix('http')}/api/folds/{fold}/play")) as robot:
        assert robot.recv(timeout=PATIENCE_S)
