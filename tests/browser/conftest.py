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
from playwright.sync_api import Browser, Error, Page, expect, sync_playwright

from tests.server.service_process import Service, bearer
from tests.tools import CHROMIUM

TIMEOUT_MS = 90_000
expect.set_options(timeout=TIMEOUT_MS)
WINDOW_FEATURES = (
    *("WebUIOmniboxPopup", "WebUIOmniboxAimPopup", "WebUIOmniboxFullPopup"),
    *("PreloadTopChromeWebUI", "SpareRendererForSitePerProcess"),
)
"""Chromium features that load hidden internal pages for each window."""
PLAYWRIGHT_FEATURES = (
    *("AvoidUnnecessaryBeforeUnloadCheckSync", "DestroyProfileOnBrowserClose", "HttpsUpgrades"),
    *("HttpsFirstBalancedModeAutoEnable", "LensOverlay", "MediaRouter", "PaintHolding"),
    *("ThirdPartyStoragePartitioning", "AvoidCorsURLLoaderRestartOnRedirect", "AimEnabled"),
    *("OptimizationHints", "NetworkTimeServiceQuerying", "PreconnectToSearch"),
)
"""Features that Playwright disables. They are repeated here, because Chromium uses only the last
list."""
# 3D graphics are rendered by software, so that machines without a graphics card draw the same.
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
    # Direct software compositing takes half the time of software that emulates a graphics card.
    "--disable-gpu-compositing",
    f"--disable-features={','.join((*WINDOW_FEATURES, *PLAYWRIGHT_FEATURES))}",
)


MEDIA: dict[str, Any] = {"color_scheme": "dark", "reduced_motion": "reduce"}


class Chromium:
    """Browser that consecutive tests share.

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

    def tab(self, site: str, *, view: bool, used: bool, toured: bool, **options: Any) -> Page:
        """Open a tab with its own profile, or reuse a recycled one."""
        if used and self._tabs[view]:
            return self._tabs[view].pop()
        context = self.browser().new_context(base_url=site, **options)
        context.set_default_timeout(TIMEOUT_MS)
        if toured:
            context.add_init_script(HAS_SEEN_A_TOUR)
        if not view:
            context.add_init_script(NO_VIEW)
        return context.new_page()

    def recycle(self, page: Page, *, view: bool) -> None:
        """Clear the state of a tab and all that pages of the site have stored.

        Its process and its cache remain: loading a fold's page takes half as long as in a new tab.
        """
        context = page.context
        for other_page in context.pages:
            if other_page is not page:
                other_page.close()
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
SHARED_BROWSER = Chromium()
Visit = Callable[..., Page]
"""Type of the fixture ``visit``."""


@pytest.hookimpl(tryfirst=True)  # before tests are selected by their marks
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if HERE in item.path.parents:
            item.add_marker("browser")
            item.add_marker("slow")


@pytest.hookimpl(trylast=True)  # after fixtures have closed what they opened in it
def pytest_runtest_teardown(nextitem: pytest.Item | None) -> None:
    if nextitem is None or HERE not in nextitem.path.parents:
        SHARED_BROWSER.close()


@pytest.fixture
def browser() -> Browser:
    return SHARED_BROWSER.browser()


@contextmanager
def visiting(service: Service) -> Generator[Visit]:
    """Yield the function of the fixture ``visit``, and close its tabs."""
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
        toured: bool = True,
        **options: Any,
    ) -> Page:
        look = {name: options.pop(name, usual) for name, usual in MEDIA.items()}
        is_plain = toured and script is None and not options
        page = SHARED_BROWSER.tab(site, view=view, used=is_plain, toured=toured, **options)
        opened.append((page, view, is_plain))
        page.set_viewport_size({"width": width, "height": height})
        page.emulate_media(**look)
        page.on("pageerror", note)
        if script is not None:
            page.add_init_script(script)
        page.goto(path)
        return page

    yield open_page
    for page, page_view, is_plain_page in opened:
        page.remove_listener("pageerror", note)
        if is_plain_page and page.url.startswith(site) and not page.is_closed():
            SHARED_BROWSER.recycle(page, view=page_view)
        else:
            page.context.close()
    assert not [error for error in thrown if "/static/" in error]


@pytest.fixture
def visit(service: Service) -> Iterator[Visit]:
    """Function that opens a page in an empty profile; fails at the end if our scripts threw an
    error.

    Tests that do not need the 3D view open the page with ``view=False``: viser's client, which
    takes seconds to load and paint, is then never loaded, and the page's own drawing stays.
    ``script`` runs before all scripts of each page. With ``toured=False``, it is the first visit,
    on which the tour starts by itself.
    """
    with visiting(service) as visit:
        yield visit


WIDTH = "document.documentElement.scrollWidth"
"""Width that the content of a page needs."""
WIDTHS = (320, 390, 600, 683, 760, 820, 1024, 1366, 1920)
"""Widths of windows, in CSS pixels: small phones to large screens; 683 is a laptop at 200 %."""
OVERFLOWING = """() => {
  const parts = "a, button, dd, dt, h1, h2, h3, input, label, legend, li, p, select, textarea";
  const strips = ".letters, .chips, .figures, .strip, .tabs"; // made to be scrolled sideways
  const scrolls = (box) => /auto|scroll/.test(getComputedStyle(box).overflowX);
  const hidden = (part) => !part.getClientRects().length || part.closest(".visually-hidden, .skip");
  const wide = document.documentElement.scrollWidth > innerWidth ? ["the page"] : [];
  for (const box of document.querySelectorAll("body, body *")) {
    if (box.matches(strips) || hidden(box) || (box !== document.body && !scrolls(box))) continue;
    const { left, right } = box.getBoundingClientRect();
    const { paddingLeft, paddingRight } = getComputedStyle(box);
    const [from, to] = [left + parseFloat(paddingLeft) - 1, right - parseFloat(paddingRight) + 1];
    for (const part of box.querySelectorAll(parts)) {
      if (hidden(part) || getComputedStyle(part).position !== "static") continue;
      let nearest = part.parentElement;
      while (nearest !== box && !scrolls(nearest)) nearest = nearest.parentElement;
      const rect = part.getBoundingClientRect();
      if (nearest === box && rect.width && (rect.left < from || rect.right > to)) {
        wide.push(`${part.localName}#${part.id} in ${box.localName}.${box.className}`);
      }
    }
  }
  return wide;
}"""
"""Returns the controls and texts that are wider than the panel that they stand in."""
HAS_SEEN_A_TOUR = "try { localStorage.setItem('foldback:toured', 'yes'); } catch {}"
"""Script after which no tour starts by itself, as for a visitor who has seen one."""
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
"""Script that keeps the 3D view from loading. A Playwright route would be slower, because it
intercepts all requests."""


def resize(page: Page, width: int, height: int) -> None:
    """Give a page a size, and wait until it is laid out anew."""
    page.set_viewport_size({"width": width, "height": height})
    page.wait_for_function(f"() => innerWidth === {width} && innerHeight === {height}")
    page.evaluate("new Promise((done) => requestAnimationFrame(() => setTimeout(done)))")


def overflowing(page: Page) -> dict[int, list[str]]:
    """Return what is wider than its panel at each of ``WIDTHS`` where something is."""
    before, frame_sizes = page.viewport_size, {}
    assert before is not None
    for width in WIDTHS:
        resize(page, width, before["height"])
        if wide := page.evaluate(OVERFLOWING):
            frame_sizes[width] = wide
    page.set_viewport_size(before)
    return frame_sizes


def choose(page: Page, name: str, data: bytes) -> None:
    """Choose a file in a page's form."""
    page.locator("#file").set_input_files(
        {"name": name, "mimeType": "application/octet-stream", "buffer": data}
    )


def open_tab(page: Page, name: str) -> None:
    """Open the details of a fold, and a tab in them."""
    page.locator("#details").click()
    page.locator(f"#tab-{name}").click()


def drag(
    page: Page, start: tuple[float, float], end: tuple[float, float], *, steps: int = 3
) -> None:
    """Move the mouse between two points of a page with its button pressed."""
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(*end, steps=steps)
    page.mouse.up()


def wait_for_preview(page: Page) -> None:
    """Wait until a page shows the figures of the preview that it last requested."""
    page.locator("body:not(.busy-now)").wait_for()


def preview_file(page: Page, name: str, data: bytes) -> None:
    """Choose a file and wait until its preview is shown."""
    choose(page, name, data)
    page.wait_for_url(re.compile("/previews/[a-z0-9]+$"))
    wait_for_preview(page)


def wait_for_fold(page: Page) -> str:
    """Return the id of the fold whose page opens after the last action."""
    page.wait_for_url(re.compile("/folds/[a-z0-9]+$"))
    return page.url.rpartition("/")[2]


def wait_for_view(page: Page) -> Page:
    """Wait until a fold's page has all frames and its 3D view shows one."""
    page.locator("#sketch.gone").wait_for(state="attached")
    page.wait_for_function("() => window.foldback.timeline.complete")
    return page


def wait_until(page: Page, true: Callable[[], bool]) -> None:
    """Wait until a condition is true, while the page keeps running."""
    deadline = time.monotonic() + TIMEOUT_MS / 1000
    while not true():
        assert time.monotonic() < deadline
        page.wait_for_timeout(20)


def cancel_fold(page: Page, service: Service) -> None:
    """Cancel the fold of a page as its owner, so that no test waits for it."""
    fold = re.findall(r"[a-z0-9]{12,}", page.url)[-1]
    token = page.evaluate(f"localStorage.getItem('foldback:owner:{fold}')")
    answer = service.http.post(f"/api/folds/{fold}/cancel", headers=bearer(token))
    assert answer.is_success, answer.text


def keep_as_mine(page: Page, fold: dict[str, Any]) -> None:
    """Store in a page's browser that it owns a fold."""
    entry = [f"foldback:owner:{fold['id']}", fold["owner_token"]]
    page.evaluate("([key, token]) => localStorage.setItem(key, token)", entry)


def seek(page: Page, frame: int) -> None:
    """Move the slider to a frame, and wait until the player shows it."""
    scrub = page.locator("#scrub")
    expect(scrub).to_be_enabled()
    # Locator.fill would focus the slider, and the keys would then go to it.
    scrub.evaluate("(s, to) => { s.value = to; s.dispatchEvent(new Event('input')); }", frame)
    at_frame(page, frame)


def at_frame(page: Page, frame: int) -> None:
    """Wait until a page shows a frame, counted from 0."""
    expect(page.locator("#r-frame")).to_have_text(re.compile(rf"^Frame {frame + 1} of "))


def shown_frame(page: Page) -> int:
    match = re.search(r"Frame ([\d\s]+) of", page.locator("#r-frame").inner_text())
    return int(re.sub(r"\s", "", match[1])) - 1


WAIT_FOR_REST = """async () => {
  const player = window.foldback?.player;
  if (!player?.standIn) return false;
  const { stage, sketch } = player.standIn;
  // Where 3D graphics are slow, a drawing replaces them while anything moves.
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
"""Waits until a fold's page and its 3D view have drawn their last state; false on other pages."""


def picture(page: Page) -> np.ndarray:
    """Return the 3D view at rest as an (h, w, 3) array, 0 to 255."""
    if page.evaluate(WAIT_FOR_REST):
        return screenshot(page)
    deadline = time.monotonic() + TIMEOUT_MS / 1000
    before = screenshot(page)
    while True:
        page.wait_for_timeout(400)
        now = screenshot(page)
        if np.abs(now - before).max() <= 2:
            return now
        assert time.monotonic() < deadline, "the view does not come to rest"
        before = now


def screenshot(page: Page) -> np.ndarray:
    """Return the current 3D view as an (h, w, 3) array, 0 to 255."""
    png = page.locator("main.stage").screenshot(mask=[page.locator("#legend")], mask_color="#000")
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(float)
