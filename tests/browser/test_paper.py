"""The paper's experiments play where they stand, one at a time."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import keep

pytestmark = pytest.mark.browser
Visit = Callable[..., Page]
FRAME = "() => foldback.player.shown?.frame"


def asked_for(page: Page) -> list[str]:
    """Films that were asked for from now on."""
    found: list[str] = []
    page.on("request", lambda request: found.append(request.url.partition("/paper/")[2]))
    return found


@pytest.mark.long
def test_a_film_plays_is_scrubbed_and_shows_where_it_tangles(visit: Visit) -> None:
    page = visit("/")
    films = asked_for(page)
    page.locator(".foot a[href='/paper']").click()
    expect(page.locator("h1")).to_have_text("The paper’s experiments, run again")
    run = page.locator("#direct .run:has(.run-where)").first
    page.locator(".overview a[href='#threshold']").click()
    expect(page.locator("#threshold-title")).to_be_in_viewport()
    # Nothing moves by itself for who wants it calm, and nothing is loaded.
    assert not [name for name in films if name.endswith("/batch")]

    run.scroll_into_view_if_needed()
    run.locator(".run-start").click()
    run.locator(".run-view.moving").wait_for()
    page.wait_for_function("() => foldback.player.is.playing && foldback.player.shown.frame > 1")
    expect(run.locator(".run-toggle")).to_be_focused()
    run.locator(".run-toggle").press(" ")
    page.wait_for_function("() => !foldback.player.is.playing")
    run.locator(".run-scrub").press("Home")
    assert page.evaluate(FRAME) == 0
    expect(run.locator(".run-now")).to_contain_text("Playback")

    run.locator(".run-where").click()
    stuck = int(run.get_attribute("data-stuck-frame") or 0)
    page.wait_for_function(f"() => foldback.player.shown.frame === {stuck}")
    marked = page.evaluate("() => foldback.player.marked.join(' ')")
    assert marked == run.get_attribute("data-stuck")
    keep(page, "paper-tangled")

    other = page.locator("#direct .run:not(:has(.run-where))").first
    other.locator(".run-start").click()
    other.locator(".run-view.moving").wait_for()
    expect(page.locator(".run canvas")).to_have_count(1)
    expect(run.locator(".run-start")).to_be_visible()
    batches = [name for name in films if name.endswith("/batch")]
    assert len(batches) == len(set(batches)) == 2


def test_the_first_film_plays_by_itself_while_it_is_seen(visit: Visit) -> None:
    page = visit("/paper", width=390, height=844, reduced_motion="no-preference")
    page.wait_for_function("() => foldback.player.is.playing")
    page.locator("#differences").scroll_into_view_if_needed()
    page.wait_for_function("() => !foldback.player.is.playing")
    page.locator("h1").scroll_into_view_if_needed()
    page.wait_for_function("() => foldback.player.is.playing")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390


def test_without_scripts_there_are_stills_and_figures(visit: Visit) -> None:
    page = visit("/paper", java_script_enabled=False)
    expect(page.locator(".run img").first).to_be_visible()
    expect(page.locator("table").first).to_be_visible()
    expect(page.locator(".run-start").first).to_be_hidden()
