"""Looking closer at a fold: colours, plots, jumps, and the path in it."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from planner.certificate.metrics import Figures
from planner.motion.timeline import Timeline
from tests.browser.conftest import Visit, picture, seek, shown_frame, visits
from tests.server.service import Service


@pytest.fixture(scope="module")
def figures(service: Service, wrench: str) -> Figures:
    return Figures.load(service.directory(wrench) / "figures.zarr")


@pytest.fixture(scope="module")
def beside(service: Service, wrench: str) -> Iterator[Page]:
    """A fold's page that tests look at one after the other: at what is told beside the view."""
    with visits(service) as visit:
        yield opened(visit, wrench, width=1440)


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


def opened(visit: Visit, fold: str, *, view: bool = False, **options: object) -> Page:
    page = visit(f"/folds/{fold}", view=view, **options)
    if view:
        page.locator("#sketch.gone").wait_for(state="attached")
    page.wait_for_function("() => window.foldback.timeline.complete")
    return page


@pytest.mark.long
def test_colours_show_each_figure(visit: Visit, wrench: str, figures: Figures) -> None:
    page = opened(visit, wrench, view=True, **SMALL)
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


def test_plots_show_figures_and_seek(beside: Page, figures: Figures) -> None:
    page = beside
    if not page.locator("#tab-plots").is_visible():
        page.locator("#details").click()
    page.locator("#tab-plots").click()
    plots = page.locator(".plot")
    expect(plots).to_have_count(4)
    seek(page, 40)
    least = plots.filter(has_text="Least clearance").locator("b")
    expect(least).to_have_text(f"{float(f'{figures.min_clearance[40]:.2g}'):g} pitch")
    box = plots.nth(0).locator("svg").bounding_box()
    page.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + 20)
    assert shown_frame(page) == pytest.approx(0.75 * (len(figures) - 1), abs=3)
    page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 20)
    where = plots.nth(0).locator(".plot-where")
    expect(where).to_contain_text(re.compile(r"^frame \d+, [\d.]+ s$"))
    assert shown_frame(page) > 0.5 * len(figures), "a reading moves nothing"
    larger = page.get_by_role("button", name="Larger view of least clearance")
    larger.click()
    large = page.locator("dialog.plot-dialog .plot svg[role=slider]")
    before = shown_frame(page)
    large.press("ArrowLeft")
    expect(large).to_have_attribute("aria-valuenow", str(before))
    page.keyboard.press("Escape")
    expect(large).to_have_count(0)
    expect(plots).to_have_count(4)
    expect(larger).to_be_focused()


@pytest.mark.long
def test_resting_view_paints_nothing_until_it_is_moved(visit: Visit, wrench: str) -> None:
    page = opened(visit, wrench, view=True, **SMALL)
    (view,) = (frame for frame in page.frames if "view" in frame.url)
    view.evaluate(COUNT_PICTURES)
    view.wait_for_function(AT_REST)
    before = view.evaluate("pictures")
    page.locator("#view").hover()
    page.mouse.wheel(0, 200)
    view.wait_for_function("(before) => pictures > before + 3", arg=before)


def test_jumps_seek_the_worst_frames(beside: Page, figures: Figures) -> None:
    page = beside
    page.locator("#jump option[value=straight]").wait_for(state="attached")
    page.wait_for_function("() => !document.querySelector('#colour-by option[disabled]')")
    for where, worst in (
        ("max_error_rad", np.nanargmax(figures.max_error_rad)),
        ("min_clearance", np.nanargmin(figures.min_clearance)),
        ("peak_torque_nm", np.nanargmax(figures.peak_torque_nm)),
    ):
        page.locator("#jump").select_option(where)
        expect(page.locator("#r-frame")).to_have_text(re.compile(f"Frame {worst + 1} of"))


def test_folded_slider_seeks_by_share(beside: Page, service: Service, wrench: str) -> None:
    page = beside
    frames = Timeline.open(service.directory(wrench) / "timeline.zarr").frames()
    first = int(np.flatnonzero(frames.phase == 1)[0])
    page.locator("#jump").select_option("straight")
    expect(page.locator("#r-frame")).to_have_text(re.compile(f"Frame {first + 1} of"))
    expect(page.locator("#r-folded")).to_have_text("0 %")
    slider = page.locator("#folded")
    slider.evaluate("(s) => { s.value = 50; s.dispatchEvent(new Event('input')); }")
    middle = shown_frame(page)
    assert first < middle < len(frames) - 1
    goal = np.abs(frames.joint_angles_rad[-1])
    reached = np.clip(frames.joint_angles_rad * np.sign(frames.joint_angles_rad[-1]), 0, goal)
    share = reached.sum(axis=1) / goal.sum()
    assert share[middle] == pytest.approx(0.5, abs=0.01)
    expect(page.locator("#r-folded")).to_have_text("50 %")


def test_module_panel_names_the_nearest_module(beside: Page, figures: Figures) -> None:
    page = beside
    frame = len(figures) - 1
    seek(page, frame)
    page.evaluate("() => window.foldback.player.send({ do: 'select', module: 5 })")
    nearest = page.locator("#panel-module [data-of=nearest]")
    expect(nearest).to_contain_text(f"Module {figures.nearest[frame, 5] + 1}, ")
    expect(nearest).to_contain_text(f"{figures.clearance[frame, 5]:.2g} pitch")
    nearest.locator("button").click()
    number = figures.nearest[frame, 5] + 1
    expect(page.locator("#panel-module h2")).to_contain_text(f"Module {number} of ")


@pytest.mark.long
def test_path_is_drawn_through_the_modules(visit: Visit, wrench: str) -> None:
    page = opened(visit, wrench, view=True, **SMALL)
    seek(page, 0)
    before = picture(page)
    page.locator("#through").click()
    expect(page.locator("#through")).to_have_attribute("aria-pressed", "true")
    after = picture(page)
    yellow = after[..., :2].min(axis=-1) - after[..., 2]
    assert yellow.max() > 60 > (before[..., :2].min(axis=-1) - before[..., 2]).max()
    page.locator("#through").click()
    assert np.abs(picture(page) - before).mean() < 1.0
