"""The 3D view of a fold: its colours, its idle state, and the path in it."""

import re

import numpy as np
import pytest
from playwright.sync_api import expect

from foldback.planner.certificate.figures_store import Figures
from tests.browser.conftest import Visit, picture, screenshot, seek, wait_for_view, wait_until
from tests.server.service_process import Service

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


SLOW_VIEW = """if (self !== top) {
  const next = requestAnimationFrame.bind(window);
  let wait = 0;
  window.requestAnimationFrame = (then) => wait ? setTimeout(() => next(then), wait) : next(then);
  const every = setInterval;
  let beats = true;
  window.setInterval = (then, ms) => every(() => { if (beats) then(); }, ms);
  window.tire = () => { wait = 400; beats = false; };
}"""
"""Script whose ``tire()`` slows the view down and stops all pictures that nothing requests."""
SMALL = {"width": 480, "height": 480}
"""Window size in pixels that software rendering paints quickly."""


def test_view_shows_figures_and_the_path_and_rests(
    visit: Visit, service: Service, wrench: str
) -> None:
    assert service.http.get(f"/folds/{wrench}/figures").status_code == 200  # which computes them
    figures = Figures.load(service.directory(wrench) / "figures")
    page = wait_for_view(visit(f"/folds/{wrench}", script=SLOW_VIEW, **SMALL))
    seek(page, int(np.nanargmax(figures.peak_torque_nm)))
    menu = page.locator("#colour-by")
    expect(menu.locator("option[disabled]")).to_have_count(0)
    expect(menu.locator("option")).to_have_count(8)
    before = picture(page)
    menu.select_option("torque")
    expect(page.locator("#legend-high")).to_have_text(re.compile(r"N·m$"))
    seen_picture = picture(page)
    assert np.abs(seen_picture - before).max() > 20  # colours have changed
    assert (
        seen_picture[..., 0] - seen_picture[..., 1:].max(axis=-1)
    ).max() < 60  # no red, for the colour-blind

    seek(page, len(figures) - 1)  # where there are joint errors; elsewhere, yellow is a position
    menu.select_option("error")
    before = picture(page)
    page.locator("#through").click()
    expect(page.locator("#through")).to_have_attribute("aria-pressed", "true")
    after = picture(page)
    yellow = after[..., :2].min(axis=-1) - after[..., 2]
    assert yellow.max() > 60 > (before[..., :2].min(axis=-1) - before[..., 2]).max()
    page.locator("#through").click()
    assert np.abs(picture(page) - before).mean() < 1.0

    (view,) = (frame for frame in page.frames if "view" in frame.url)
    view.evaluate(COUNT_PICTURES)
    view.wait_for_function(AT_REST)
    painted = view.evaluate("pictures")
    page.locator(".surface").hover()
    page.mouse.wheel(0, 200)
    view.wait_for_function("(before) => pictures > before + 3", arg=painted)

    # The idle view draws the next frame on a slow machine, too.
    seek(page, 0)
    folded = picture(page)
    page.add_style_tag(content="#sketch { display: none }")  # the sketch would cover the view
    page.locator("#follow").click()  # a moving camera would make the view paint anyway
    view.evaluate("() => tire()")
    view.wait_for_function(AT_REST)
    page.locator("#jump").select_option("straight")
    wait_until(page, lambda: bool(np.abs(screenshot(page) - folded).max() > 50))


HOLD_PICTURES = """if (self !== top) {
  const next = requestAnimationFrame.bind(window);
  let held = [];
  window.requestAnimationFrame = (then) => (held ? held.push(then) : next(then));
  window.release = () => { const all = held; held = null; all.forEach(next); };
}"""
"""Script that holds back the pictures of the view until ``release()``."""
WAIT = "async () => { for (let k = 0; k < 40; k++) await new Promise(requestAnimationFrame); }"


def test_drawing_stays_until_the_3d_view_has_painted(visit: Visit, wrench: str) -> None:
    page = visit(f"/folds/{wrench}", width=390, height=520, has_touch=True, script=HOLD_PICTURES)
    page.wait_for_function("() => window.foldback.player.stage.open")
    expect(page.locator(".keyboard")).to_have_css("display", "none")  # touch devices have none
    page.keyboard.press("End")
    page.evaluate(WAIT)
    expect(page.locator("#sketch")).not_to_have_class(re.compile("gone"))
    page.frames[1].evaluate("() => release()")
    page.locator("#sketch.gone").wait_for(state="attached")
    assert (picture(page).mean(axis=-1) > 90).sum() > 500
