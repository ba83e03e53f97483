"""Playback controls by keyboard and by frame number; most tests share one page."""

import re
from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from foldback.planner.certificate.figures_store import Figures
from foldback.words.messages import nearest_frame
from tests.browser.conftest import at_frame, drag, seek, shown_frame, visiting
from tests.server.service_process import Service

GROUND = "() => getComputedStyle(document.body).backgroundColor"


@pytest.fixture(scope="module")
def page(service: Service, wrench: str) -> Iterator[Page]:
    with visiting(service) as visit:
        page = visit(f"/folds/{wrench}", width=1366, height=768, view=False)
        page.wait_for_function("() => window.foldback?.timeline.complete")
        yield page


@pytest.fixture(scope="module")
def figures(service: Service, wrench: str) -> Figures:
    return Figures.load(service.directory(wrench) / "figures")


def test_frame_is_typed(page: Page) -> None:
    seek(page, 4)
    page.locator("#r-frame").click()
    field = page.locator("#frame")
    expect(field).to_be_focused()
    page.keyboard.type("31")  # typing replaces the old number
    page.keyboard.press("Enter")
    at_frame(page, 30)
    expect(page.locator("body")).to_be_focused()  # the keyboard controls the page again
    page.keyboard.press("g")
    field.fill("99999")
    page.keyboard.press("Enter")
    expect(field).to_have_attribute("aria-invalid", "true")
    assert "Enter a whole number from 1 to" in field.evaluate("(f) => f.validationMessage")
    page.keyboard.press("Escape")
    expect(field).to_be_hidden()
    assert shown_frame(page) == 30


def test_keys_step_and_are_listed_and_single_letters_are_turned_off(page: Page) -> None:
    seek(page, 30)
    page.keyboard.press(".")  # steps by one second
    assert shown_frame(page) > 31
    seek(page, 30)
    page.keyboard.press("n")  # steps to the next visible change
    assert shown_frame(page) > 30
    expect(page.locator("#keys-said")).to_have_text(page.locator("#r-frame").inner_text())
    page.keyboard.press(">")
    expect(page.locator("#speed")).to_have_value("2")
    page.keyboard.press("[")
    expect(page.locator("#speed")).to_have_value("1")
    seek(page, 30)
    page.keyboard.press("?")
    dialog = page.locator("#keys-dialog")
    expect(dialog).to_be_visible()
    assert dialog.locator("dt").count() >= 15
    page.keyboard.press("ArrowRight")  # the page behind the dialog does not move
    at_frame(page, 30)
    page.locator("#keys-off").check()
    dialog.get_by_role("button", name="Close").click()
    page.keyboard.press("n")
    at_frame(page, 30)
    page.keyboard.press("ArrowRight")
    at_frame(page, 31)
    page.locator("#keys").click()
    page.locator("#keys-off").uncheck()
    page.keyboard.press("Escape")
    page.locator("#scrub").focus()
    page.keyboard.press("f")
    expect(page.locator("#full")).to_have_attribute("aria-pressed", "true")
    assert page.evaluate("() => Boolean(document.fullscreenElement)")
    page.keyboard.press("f")
    expect(page.locator("#full")).to_have_attribute("aria-pressed", "false")


def test_range_is_looped_and_linked(page: Page) -> None:
    seek(page, 20)
    page.keyboard.press("i")
    seek(page, 60)
    page.keyboard.press("o")
    page.wait_for_url(re.compile(r"#frame=61&from=21&to=61$"))
    start = page.get_by_role("slider", name="Loop from")
    expect(start).to_have_attribute("aria-valuenow", "21")
    start.focus()
    for key in ("ArrowRight", "PageUp", "Shift+ArrowLeft"):
        page.keyboard.press(key)
    expect(start).to_have_attribute("aria-valuenow", "22")
    end, track = page.locator("#range-to").bounding_box(), page.locator("#track").bounding_box()
    middle = (track["x"] + track["width"] / 2, end["y"] + 20)
    drag(page, (end["x"] + 12, end["y"] + 20), middle)
    to = int(page.locator("#range-to").get_attribute("aria-valuenow") or 0)
    half = int(page.locator("#scrub").get_attribute("max") or 0) / 2
    assert to == pytest.approx(half + 1, abs=1)
    page.locator("#share").click()
    expect(page.locator("#share-link")).to_have_value(re.compile(rf"&from=22&to={to}$"))
    page.keyboard.press("Escape")
    page.keyboard.press("x")
    page.keyboard.press("l")
    expect(page.locator("#range")).to_be_hidden()


def test_module_is_chosen_by_number_and_along_the_chain(page: Page) -> None:
    page.keyboard.press("m")
    field = page.locator("#module-number")
    expect(field).to_be_focused()
    page.keyboard.type("7")
    page.keyboard.press("Enter")
    heading = page.locator("#panel-module h2")
    expect(heading).to_have_text(re.compile("^Module 7 of "))
    expect(field).to_be_focused()
    page.keyboard.press("ArrowUp")
    expect(heading).to_have_text(re.compile("^Module 8 of "))
    expect(page.locator("#panel-module [role=status]")).to_have_text(re.compile("^Module 8 of "))
    field.fill("25")
    page.keyboard.press("Enter")
    assert "from 1 to 24" in field.evaluate("(f) => f.validationMessage")
    page.get_by_role("button", name="Previous module").click()
    expect(heading).to_have_text(re.compile("^Module 7 of "))
    page.get_by_role("button", name="Clear").click()
    expect(page.locator("#panel-module")).to_contain_text("type its number")


def test_plots_show_figures_and_seek(page: Page, figures: Figures) -> None:
    if not page.locator("#tab-plots").is_visible():
        page.locator("#details").click()
    page.locator("#tab-plots").click()
    plots = page.locator(".plot")
    expect(plots).to_have_count(4)
    seek(page, 40)
    plot = page.get_by_role("slider", name="Smallest clearance")
    plot.focus()
    page.keyboard.press("PageUp")
    page.keyboard.press("ArrowLeft")
    at_frame(page, 49)
    minimum = f"{float(f'{figures.min_clearance[49]:.2g}'):g} pitch"
    expect(plot).to_have_attribute("aria-valuetext", f"Frame 50, smallest clearance {minimum}")
    expect(plots.filter(has_text="Smallest clearance").locator("b")).to_have_text(minimum)
    with page.expect_download() as download:
        page.get_by_role("button", name="Smallest clearance as CSV").click()
    table = np.genfromtxt(download.value.path(), delimiter=",", names=True)
    np.testing.assert_allclose(table["min_clearance"], figures.min_clearance, rtol=1e-6)

    box = plots.nth(0).locator("svg").bounding_box()
    page.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + 20)
    assert shown_frame(page) == pytest.approx(0.75 * (len(figures) - 1), abs=3)
    page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 20)
    locator = plots.nth(0).locator(".plot-where")
    expect(locator).to_contain_text(re.compile(r"^frame \d+, [\d.]+ s$"))
    assert shown_frame(page) > 0.5 * len(figures), "a reading moves nothing"
    larger = page.get_by_role("button", name="Larger view of smallest clearance")
    larger.click()
    large = page.locator(".plot:popover-open svg[role=slider]")
    before = shown_frame(page)
    large.press("ArrowLeft")
    expect(large).to_have_attribute("aria-valuenow", str(before))
    page.keyboard.press("Escape")
    expect(large).to_have_count(0)
    expect(larger).to_be_focused()


def test_slider_seeks_a_share_and_jumps_the_worst_frames(page: Page, figures: Figures) -> None:
    page.locator("#jump option[value=straight]").wait_for(state="attached")
    page.wait_for_function("() => !document.querySelector('#colour-by option[disabled]')")
    page.locator("#folded").fill("50")
    expect(page.locator("#r-folded")).to_have_text("50 %")
    # No robot follows the explosion: the smallest clearance is that of the plan.
    playback, tightest = page.evaluate(
        """async () => [
          window.foldback.timeline.outline.phases.find(({ name }) => name === "playback").from,
          (await (await fetch(`${location.pathname}/facts`)).json()).tightest,
        ]"""
    )
    assert playback <= tightest
    for tick_place, worst in (
        ("max_error_rad", np.nanargmax(figures.max_error_rad)),
        ("min_clearance", nearest_frame(tightest)),
        ("peak_torque_nm", playback + np.nanargmax(figures.peak_torque_nm[playback:])),
    ):
        page.locator("#jump").select_option(tick_place)
        expect(page.locator("#r-frame")).to_have_text(re.compile(f"Frame {worst + 1} of"))


def test_module_panel_names_the_nearest_module(page: Page, figures: Figures) -> None:
    frame = len(figures) - 1
    seek(page, frame)
    page.evaluate("() => window.foldback.player.send({ do: 'select', module: 5 })")
    nearest, number = page.locator("#panel-module [data-of=nearest]"), figures.nearest[frame, 5] + 1
    expect(nearest).to_contain_text(f"Module {number}, ")
    expect(nearest).to_contain_text(f"{figures.clearance[frame, 5]:.2g} pitch")
    nearest.locator("button").click()
    expect(page.locator("#panel-module h2")).to_contain_text(f"Module {number} of ")


UNCUT = """text => text.scrollWidth <= text.clientWidth && text.scrollHeight <= text.clientHeight
  && text.getBoundingClientRect().right <= innerWidth"""
"""Expression that is true if no part of a text is cut off."""


def test_verdict_and_bar_fit_a_phone(page: Page) -> None:
    page.set_viewport_size({"width": 360, "height": 844})
    if page.locator("#drawer").is_visible():
        page.locator("#drawer-close").click()
    for name in ("#folded", "#jump", "#details", "#speed", "#keys", "#full"):
        expect(page.locator(name)).to_be_in_viewport(ratio=1)
    assert page.locator("#verdict").evaluate(UNCUT)
    bar = page.locator("#bar").bounding_box()
    assert bar["height"] <= 171  # the slider adds no height


def test_theme_is_stored_and_set_before_the_first_paint(page: Page) -> None:
    dark = page.evaluate(GROUND)
    page.locator("#details").focus()
    page.keyboard.press("t")
    light = page.evaluate(GROUND)
    assert light != dark
    page.goto("/gallery")
    assert page.evaluate(GROUND) == light
    # The script is in the head, before all that is painted; modules would run later.
    stands = "() => document.querySelector('head script:not([src])').type"
    assert page.evaluate(stands) == ""
    assert page.evaluate("() => document.documentElement.dataset.theme") == "light"
    for theme in ("light", "dark"):
        page.get_by_role("button", name=f"Theme: {theme}").click()
    expect(page.get_by_role("button", name="Theme: system")).to_be_visible()
    assert page.evaluate(GROUND) == dark
