from __future__ import annotations

import io
import re
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import (
    Browser,
    BrowserContext,
    Page,
    Response,
    expect,
    sync_playwright,
)

from tests.server.service import Service, bearer
from tests.tools import CHROMIUM

ARTIFACTS = Path(__file__).parents[2] / "artifacts"
PATIENCE_MS = 90_000
expect.set_options(timeout=PATIENCE_MS)
OF_WINDOWS = (
    *("WebUIOmniboxPopup", "WebUIOmniboxAimPopup", "WebUIOmniboxFullPopup"),
    *("PreloadTopChromeWebUI", "SpareRendererForSitePerProcess"),
)
"""Chromium features that load hidden internal pages for each window."""
OF_PLAYWRIGHT = (
    *("AvoidUnnecessaryBeforeUnloadCheckSync", "DestroyProfileOnBrowserClose", "HttpsUpgrades"),
    *("HttpsFirstBalancedModeAutoEnable", "LensOverlay", "MediaRouter", "PaintHolding"),
    *("ThirdPartyStoragePartitioning", "AvoidCorsURLLoaderRestartOnRedirect", "AimEnabled"),
    *("OptimizationHints", "NetworkTimeServiceQuerying", "PreconnectToSearch"),
)
"""What Playwright switches off: Chromium heeds only the last list that it is given."""
# 3D by software, so that a machine without a graphics card draws as well.
FLAGS = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    # What is software anyway puts pages together at half the cost of software that plays a card.
    "--disable-gpu-compositing",
    f"--disable-features={','.join((*OF_WINDOWS, *OF_PLAYWRIGHT))}",
)


class Chromium:
    """One browser for tests that follow each other; what visitors keep is in their contexts.

    While it is open nothing else in this process can use asyncio, as tests elsewhere do.
    """

    def __init__(self) -> None:
        self._opened = ExitStack()
        self._browser: Browser | None = None

    def browser(self) -> Browser:
        if self._browser is None:
            path = CHROMIUM.get()
            chromium = self._opened.enter_context(sync_playwright()).chromium
            self._browser = chromium.launch(executable_path=path, args=FLAGS)
            self._opened.callback(self._browser.close)
        return self._browser

    def close(self) -> None:
        self._browser = None
        self._opened.close()


HERE = Path(__file__).parent
OPEN = Chromium()


@pytest.hookimpl(trylast=True)  # after fixtures have closed what they opened in it
def pytest_runtest_teardown(nextitem: pytest.Item | None) -> None:
    if nextitem is None or HERE not in nextitem.path.parents:
        OPEN.close()


@pytest.fixture
def browser() -> Browser:
    return OPEN.browser()


@contextmanager
def visits(browser: Browser, service: Service) -> Generator[Callable[..., Page]]:
    """What ``visit`` is."""
    contexts: list[BrowserContext] = []
    thrown: list[str] = []

    def open_page(
        path: str, *, width: int = 800, height: int = 560, view: bool = True, **options: Any
    ) -> Page:
        context = browser.new_context(
            base_url=str(service.http.base_url),
            viewport={"width": width, "height": height},
            **{"color_scheme": "dark", "reduced_motion": "reduce", **options},
        )
        contexts.append(context)
        context.set_default_timeout(PATIENCE_MS)
        if not view:
            leave_view_out(context)
        page = context.new_page()
        page.on("pageerror", lambda error: thrown.append(f"{error}\n{error.stack}"))
        page.goto(path)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert not [error for error in thrown if "/static/" in error]


@pytest.fixture
def visit(browser: Browser, service: Service) -> Iterator[Callable[..., Page]]:
    """Opens a page in a fresh profile; at the end none of our scripts may have thrown.

    Who does not look at the 3D view opens it with ``view=False``: the client, which is loaded and
    paints for seconds, never comes, and the page's own drawing stays.
    """
    with visits(browser, service) as visit:
        yield visit


VIEW = "**/view"


def leave_view_out(context: BrowserContext) -> None:
    """Has the client never come from now on; ``context.unroute(VIEW)`` has it come again."""
    context.route(VIEW, lambda route: route.fulfill(body="", content_type="text/html"))


def keep(page: Page, name: str) -> None:
    """Saves a screenshot to look at, for who has made a directory ``artifacts``."""
    if ARTIFACTS.is_dir():
        page.screenshot(path=ARTIFACTS / f"{name}.png")


def called_off(page: Page, service: Service) -> None:
    """Cancels the fold whose page this is, as its owner: for who does not wait for it."""
    fold = re.findall(r"[a-z0-9]{12,}", page.url)[-1]
    token = page.evaluate(f"localStorage.getItem('foldback:owner:{fold}')")
    answer = service.http.post(f"/api/folds/{fold}/cancel", headers=bearer(token))
    assert answer.is_success, answer.text


AT_REST = """async () => {
  const player = window.foldback?.player;
  if (!player?.standIn) return false;
  const { stage, sketch } = player.standIn;
  // Where 3D graphics are slow a drawing stands in for as long as anything moves.
  const standing = () => document.querySelector(".standing-in");
  const moving = () => player.busy || player.due || sketch.waiting || standing();
  const soon = () => new Promise((done) => setTimeout(done, 50));
  do {
    while (moving()) await soon();
    if (stage.open) await new Promise((done) => stage.painted(done));
    else await soon();
  } while (moving());
  return true;
}"""
"""Waits for what a fold's page shows last to be drawn, by the 3D view too; false elsewhere."""


def picture(page: Page) -> np.ndarray:
    """The 3D view as (h, w, 3) numbers, once it has come to rest."""
    if page.evaluate(AT_REST):
        return shot(page)
    deadline = time.monotonic() + PATIENCE_MS / 1000
    before = shot(page)
    while True:
        page.wait_for_timeout(400)
        now = shot(page)
        if np.abs(now - before).max() <= 2:
            return now
        assert time.monotonic() < deadline, "the view does not come to rest"
        before = now


def shot(page: Page) -> np.ndarray:
    """The same at once, whatever moves."""
    png = page.locator("main.stage").screenshot(mask=[page.locator("#legend")], mask_color="#000")
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(float)


def bytes_fetched(page: Page) -> list[int]:
    """Sizes of the batches and scene bundles that a page fetches; grows as it does."""
    fetched: list[int] = []

    def count(response: Response) -> None:
        if "/batch?" in response.url or response.url.endswith("/bundle"):
            fetched.append(int(response.headers["content-length"]))

    page.on("response", count)
    return fetched
