"""A service below a path of a host: its pages and scripts request nothing outside that path."""

import re

import httpx
import pytest
from playwright.sync_api import Browser, expect

from foldback.client import Client
from tests.browser.conftest import MEDIA, open_tab
from tests.server.service_process import Service

BASE = "/fold"
ADDRESSES = """() => [...document.querySelectorAll("[href], [src], [action], [data-timeline]")]
  .map((each) => each.getAttribute("href") ?? each.getAttribute("src")
    ?? each.getAttribute("action") ?? each.dataset.timeline)
  .filter((address) => address.startsWith("/"))"""


@pytest.mark.long
def test_pages_below_a_path_ask_for_nothing_beside_it(
    browser: Browser, tmp_path_factory: pytest.TempPathFactory
) -> None:
    data = tmp_path_factory.mktemp("below") / "data"
    with Service(data, base_path=BASE, workers=0, shipped_folds=True).start() as service:
        open_all_pages(f"http://{service.netloc}{BASE}", browser)


def open_all_pages(base_url: str, browser: Browser) -> None:
    """Open all pages, and play the folds on them."""
    with Client(base_url) as client:
        fold = min(created_fold.refresh().id for created_fold in client.folds())
        assert client.get(fold).verified
    page = browser.new_page(**MEDIA)
    wrong: list[str] = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("response", lambda answer: wrong.append(answer.url) if answer.status >= 400 else None)
    fine = re.compile(rf"(blob:|data:|{re.escape(base_url)}/)")
    page.on(
        "request", lambda request: None if fine.match(request.url) else wrong.append(request.url)
    )
    for path in ("/", "/gallery", "/paper", "/benchmarks", "/docs", "/my-folds", "/shapes/new"):
        page.goto(base_url + path, wait_until="networkidle")
        assert [
            address for address in page.evaluate(ADDRESSES) if not address.startswith(f"{BASE}/")
        ] == []
    for path in (f"/embed/{fold}", f"/compare?a={fold}&b={fold}", f"/folds/{fold}"):
        page.goto(base_url + path)
        expect(page.locator("#scrub")).to_be_enabled()
        page.locator("#play").click()
        page.wait_for_function("() => +document.getElementById('scrub').value > 0")
    page.locator("#sketch.gone").wait_for(state="attached")  # the 3D view is shown
    open_tab(page, "downloads")
    page.get_by_text("All files", exact=True).click()
    links = page.locator("#panel-downloads a[download]:visible")
    for href in links.evaluate_all("(all) => all.map((one) => one.href)"):
        assert httpx.head(href, timeout=60).is_success, href
    assert page.locator('meta[property="og:image"]').get_attribute("content") == (
        f"{base_url}/folds/{fold}/picture.png"
    )
    assert wrong == []
    page.close()
