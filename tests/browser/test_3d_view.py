"""The 3D view of a fold: its colours, its rest, and the path in it."""

from __future__ import annotations

import re

import numpy as np
import pytest
from playwright.sync_api import expect

from planner.certificate.metrics import Figures
from tests.browser.conftest import Visit, picture, seek, with_view
from tests.server.service import Service

pytestmark = pytest.mark.long
COUNT_PICTURES = """() => {
  const { clear } = WebGL2RenderingContext.prototype;
  let latest = null;
  window.pictures = 0;
  WebGL2RenderingContext.prototype.clear = function (...given) {
    if (document.timeline.currentTime !== latest) window.pictures++;
    latest = document.timeline.currentTime;
    return clear.apply(this, given);
  };
}"""
AT_REST = """() => new Promise((done) => {
  const before = window.pictures;
  setTimeout(() => done(window.pictures - before <= 3), 2000);
})"""


SMALL = {"width": 480, "height": 480}
"""Window size in pixels that software rendering paints quickly."""


def test_colours_show_each_figure(visit: Visit, service: Service, wrench: str) -> None:
    figures = Figures.load(service.directory(wrench) / "figures.zarr")
    page = with_view(visit(f"/folds/{wrench}", **SMALL))
    seek(page, int(np.nanargmax(figures.peak_torque_nm)))
    menu = page.locator("#colour-by")
    expect(menu.locator("option[disabled]")).to_have_count(0)
    expect(menu.locator("option")).to_have_count(7)
    before = picture(page)
    menu.select_option("torque")
    expect(page.locator("#legend-high")).to_have_text(re.compile(r"N·m$"))
    seen = picture(page)
    assert np.abs(seen - before).max() > 20  # from some red to some of another colour
    assert (seen[..., 0] - seen[..., 1:].max(axis=-1)).max() < 60  # not what only some people see
    menu.select_option("chain")
    page.wait_for_url(re.compile("colour=chain"))  # the address follows a moment later
    page.reload()
    expect(menu).to_have_value("chain")  # it is kept


def test_resting_view_paints_nothing_until_it_is_moved(visit: Visit, wrench: str) -> None:
    page = with_view(visit(f"/folds/{wrench}", **SMALL))
    (view,) = (frame for frame in page.frames if "view" in frame.url)
    expect(view.get_by_role("application", name="3D view")).to_have_attribute(
        "data-engine", re.compile("three")
    )
    view.evaluate(COUNT_PICTURES)
    view.wait_for_function(AT_REST)
    before = view.evaluate("pictures")
    page.locator("#view").hover()
    page.mouse.wheel(0, 200)
    view.wait_for_function("(before) => pictures > before + 3", arg=before)


def test_path_is_drawn_through_the_modules(visit: Visit, wrench: str) -> None:
    page = with_view(visit(f"/folds/{wrench}", **SMALL))
    seek(page, 0)
    before = picture(page)
    page.locator("#through").click()
    expect(page.locator("#through")).to_have_attribute("aria-pressed", "true")
    after = picture(page)
    yellow = after[..., :2].min(axis=-1) - after[..., 2]
    assert yellow.max() > 60 > (before[..., :2].min(axis=-1) - before[..., 2]).max()
    page.locator("#through").click()
    assert np.abs(picture(page) - before).mean() < 1.0
