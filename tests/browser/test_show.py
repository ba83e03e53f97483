"""A fold in a viser server of its own, in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from planner.chain.chain import Chain
from planner.chain.path import Path as CellPath
from planner.motion.timeline import TimelineWriter
from tests.browser.conftest import PATIENCE_MS, until
from tests.web.conftest import SNAKE, folding
from web.viser import Shown, show

pytestmark = [
    pytest.mark.browser,
    # viser tells so of a page that is closed just as its camera is moved.
    pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection:UserWarning"),
]
LAST = 59


@pytest.fixture
def shown(tmp_path: Path) -> Iterator[Shown]:
    chain = Chain.from_path(CellPath.from_cells(SNAKE, name="<b>snake</b>"))
    path = tmp_path / "timeline.zarr"
    with TimelineWriter.create(path, chain) as writer:
        writer.append(folding(chain, LAST + 1))
    with show(path, port=0) as shown:
        yield shown


@pytest.fixture
def page(browser: Browser, shown: Shown) -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 800, "height": 360})
    context.set_default_timeout(PATIENCE_MS)
    page = context.new_page()
    page.goto(shown.url)
    yield page
    context.close()


def whole_chain_in_view(shown: Shown) -> bool:
    """Whether whoever looks sees all modules, wherever they are."""
    (client,) = shown.server.get_clients().values()
    camera = client.camera
    ahead = camera.look_at - camera.position
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    off = shown._cameras._points - camera.position
    tall = np.tan(camera.fov / 2)
    across = np.abs(off @ right / (off @ ahead)).max()
    upwards = np.abs(off @ np.cross(right, ahead) / (off @ ahead)).max()
    return bool(across < tall * camera.aspect and upwards < tall)


@pytest.mark.long
def test_viser_server_scrubs_selects_and_plays(page: Page, shown: Shown) -> None:
    expect(page.get_by_text(f"Frame 1 of {LAST + 1}")).to_be_visible()
    expect(page.get_by_text("<b>snake</b>")).to_be_visible()  # a name stays a name
    until(page, lambda: len(shown._cameras._aspects) == 1 and whole_chain_in_view(shown))
    slider = page.get_by_role("slider")
    slider.focus()
    slider.press("End")
    until(page, lambda: shown.frame == LAST)
    expect(page.get_by_text(f"Frame {LAST + 1} of {LAST + 1}")).to_be_visible()
    until(page, lambda: whole_chain_in_view(shown))

    expect(page.locator("canvas").first).to_be_visible()
    page.mouse.click(295, 230)  # the nearest module
    until(page, lambda: shown._selected is not None)
    expect(page.get_by_text(f"Module {shown._selected + 1} of {len(SNAKE)}")).to_be_visible()

    page.get_by_role("button", name="Play").click()  # from the first frame again
    expect(page.get_by_role("button", name="Pause")).to_be_visible()
    until(page, lambda: 0 < shown.frame < LAST)
