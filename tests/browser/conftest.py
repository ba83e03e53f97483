from __future__ import annotations

import io
import json
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
    Error,
    Page,
    expect,
    sync_playwright,
)

from tests.server.service_process import Service, bearer
from tests.tools import CHROMIUM

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


LOOK: dict[str, Any] = {"color_scheme": "dark", "reduced_motion": "reduce"}


class Chromium:
    """One browser for tests that follow each other.

    While it is open nothing else in this process can use asyncio, as tests elsewhere do.
    """

    def __init__(self) -> None:
        self._opened = ExitStack()
        self._browser: Browser | None = None
        self._tabs: dict[bool, list[Page]] = {True: [], False: []}

    def browser(self) -> Browser:
        if self._browser is None:
            path = CHROMIUM.get()
            chromium = self._opened.enter_context(sync_playwright()).chromium
            self._browser = chromium.launch(executable_path=path, args=FLAGS)
            self._opened.callback(self._browser.close)
        return self._browser

    def tab(self, site: str, *, view: bool, used: bool, **options: Any) -> Page:
        """Open a tab with its own profile, or hand out one that was put back."""
        if used and self._tabs[view]:
            return self._tabs[view].pop()
        context = self.browser().new_context(base_url=site, **options)
        context.set_default_timeout(PATIENCE_MS)
        if not view:
            context.add_init_script(NO_VIEW)
        return context.new_page()

    def put_back(self, page: Page, *, view: bool) -> None:
        """Forget all that a tab was told, and what pages of the site stored.

        Its process and its cache stay: loading a fold's page takes half as long as in a new tab.
        """
        context = page.context
        for other in context.pages:
            if other is not page:
                other.close()
        context.set_offline(False)
        context.unroute_all()
        page.unroute_all()
        page.goto("/health")  # a page of the same site, so that the process stays
        page.evaluate("() => { localStorage.clear(); sessionStorage.clear(); }")
        context.clear_cookies()
        page.mouse.move(0, 0)
        self._tabs[view].append(page)

    def close(self) -> None:
        self._browser = None
        for tabs in self._tabs.values():
            tabs.clear()
        self._opened.close()


HERE = Path(__file__).parent
OPEN = Chromium()
Visit = Callable[..., Page]
"""The fixture ``visit``."""


@pytest.hookimpl(tryfirst=True)  # before tests are chosen by their marks
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if HERE in item.path.parents:
            item.add_marker("browser")
            item.add_marker("slow")


@pytest.hookimpl(trylast=True)  # after fixtures have closed what they opened in it
def pytest_runtest_teardown(nextitem: pytest.Item | None) -> None:
    if nextitem is None or HERE not in nextitem.path.parents:
        OPEN.close()


@pytest.fixture
def browser() -> Browser:
    return OPEN.browser()


@contextmanager
def visits(service: Service) -> Generator[Visit]:
    """What ``visit`` is."""
    site = str(service.http.base_url)
    opened: list[tuple[Page, bool, bool]] = []
    thrown: list[str] = []

    def note(error: Error) -> None:
        thrown.append(f"{error}\n{error.stack}")

    def open_page(
        path: str,
        *,
        width: int = 800,
        height: int = 560,
        view: bool = True,
        script: str | None = None,
        **options: Any,
    ) -> Page:
        look = {name: options.pop(name, usual) for name, usual in LOOK.items()}
        again = script is None and not options
        page = OPEN.tab(site, view=view, used=again, **options)
        opened.append((page, view, again))
        page.set_viewport_size({"width": width, "height": height})
        page.emulate_media(**look)
        page.on("pageerror", note)
        if script is not None:
            page.add_init_script(script)
        page.goto(path)
        return page

    yield open_page
    for page, view, again in opened:
        page.remove_listener("pageerror", note)
        if again and page.url.startswith(site) and not page.is_closed():
            OPEN.put_back(page, view=view)
        else:
            page.context.close()
    assert not [error for error in thrown if "/static/" in error]


@pytest.fixture
def visit(service: Service) -> Iterator[Visit]:
    """Opens a page in a profile that holds nothing; none of our scripts may have thrown at the end.

    Who does not look at the 3D view opens it with ``view=False``: the client, which is loaded and
    paints for seconds, never comes, and the page's own drawing stays. ``script`` runs before all
    scripts of each page.
    """
    with visits(service) as visit:
        yield visit


WIDTH = "document.documentElement.scrollWidth"
"""Width that the content of a page needs."""
NO_WEBGL = "HTMLCanvasElement.prototype.getContext = () => null"
NO_VIEW = """{
  const { prototype } = HTMLIFrameElement;
  const { get, set } = Object.getOwnPropertyDescriptor(prototype, "src");
  Object.defineProperty(prototype, "src", {
    configurable: true,
    get,
    set(address) { set.call(this, address.endsWith("/view") ? "about:blank" : address); },
  });
}"""
"""Has the 3D view never come, without the cost of a route, through which all requests would go."""


def choose(page: Page, name: str, data: bytes) -> None:
    """Choose a file in a page's form."""
    page.locator("#file").set_input_files(
        {"name": name, "mimeType": "application/octet-stream", "buffer": data}
    )


def answered(page: Page) -> None:
    """Wait until the figures of a preview are those of what was asked for last."""
    page.locator("body:not(.busy-now)").wait_for()


def previewed(page: Page, name: str, data: bytes) -> None:
    """Choose a file and wait until its preview is there."""
    choose(page, name, data)
    page.wait_for_url(re.compile("/previews/[a-z0-9]+$"))
    answered(page)


def path_file(cells: object) -> bytes:
    """Return the file of a path."""
    return json.dumps({"format": "foldback-path/1", "cells": cells}).encode()


def opened_fold(page: Page) -> str:
    """Return the id of the fold whose page is opened by what was done last."""
    page.wait_for_url(re.compile("/folds/[a-z0-9]+$"))
    return page.url.rpartition("/")[2]


def with_view(page: Page) -> Page:
    """Wait until a fold's page has all frames and its 3D view shows one."""
    page.locator("#sketch.gone").wait_for(state="attached")
    page.wait_for_function("() => window.foldback.timeline.complete")
    return page


def until(page: Page, true: Callable[[], bool]) -> None:
    """Wait, while the page goes on, until a condition is true."""
    deadline = time.monotonic() + PATIENCE_MS / 1000
    while not true():
        assert time.monotonic() < deadline
        page.wait_for_timeout(20)


def cancel_fold(page: Page, service: Service) -> None:
    """Cancel the fold whose page this is, as its owner: for tests that do not wait for it."""
    fold = re.findall(r"[a-z0-9]{12,}", page.url)[-1]
    token = page.evaluate(f"localStorage.getItem('foldback:owner:{fold}')")
    answer = service.http.post(f"/api/folds/{fold}/cancel", headers=bearer(token))
    assert answer.is_success, answer.text


def keep_as_mine(page: Page, fold: dict[str, Any]) -> None:
    """Have a page's browser remember that a fold is its own."""
    told = [f"foldback:owner:{fold['id']}", fold["owner_token"]]
    page.evaluate("([key, token]) => localStorage.setItem(key, token)", told)


def seek(page: Page, frame: int) -> None:
    """Scrub with the slider, and wait until the player is there."""
    scrub = page.locator("#scrub")
    expect(scrub).to_be_enabled()
    # Filled in it would get the focus, and with it the keys.
    scrub.evaluate("(s, to) => { s.value = to; s.dispatchEvent(new Event('input')); }", frame)
    at_frame(page, frame)


def at_frame(page: Page, frame: int) -> None:
    """Wait until a page shows a frame, counted from 0."""
    expect(page.locator("#r-frame")).to_have_text(re.compile(rf"^Frame {frame + 1} of "))


def shown_frame(page: Page) -> int:
    found = re.search(r"Frame ([\d\s]+) of", page.locator("#r-frame").inner_text())
    return int(re.sub(r"\s", "", found[1])) - 1


AT_REST = """async () => {
  const player = window.foldback?.player;
  if (!player?.standIn) return false;
  const { stage, sketch } = player.standIn;
  // Where 3D graphics are slow a drawing stands in for as long as anything moves.
  const standing = () => document.querySelector(".standing-in");
  const moving = () => player.busy || player.ticker.due || sketch.waiting || standing();
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
