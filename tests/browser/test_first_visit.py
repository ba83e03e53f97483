"""The first visit to a fold: the tour starts by itself, once."""

import re

from playwright.sync_api import expect

from tests.browser.conftest import Visit

MOVING = {"reduced_motion": "no-preference", "width": 480, "height": 640}


def test_tour_starts_by_itself_on_the_first_visit_alone(visit: Visit, wrench: str) -> None:
    address = f"/folds/{wrench}"
    page = visit(f"{address}#frame=9", view=False, toured=False, **MOVING)
    panel, caption = page.locator("#tour-panel"), page.locator("#tour-caption")
    expect(page.locator("#tour")).to_be_visible()
    for other in (f"/embed/{wrench}", f"{address}?view=9,,,1"):
        page.goto(other)
        expect(page.locator("#tour")).to_be_visible()
    expect(panel).to_be_hidden()  # an address with a view, and an embed, show what they name

    page.goto(address)
    expect(caption).to_contain_text("a motion that unfolds it")
    assert page.evaluate("foldback.player.playhead.frame") == 0  # as long as one reads
    expect(page.locator("#tour-hint")).to_be_visible()
    expect(page.locator("#tour-run")).to_have_text("Pause")
    page.wait_for_function("() => foldback.player.is.playing && foldback.player.is.loop")
    page.locator("#tour-after").click()
    expect(caption).to_contain_text("The chain is straight")
    page.locator("#tour-before").click()
    # Colours that were chosen survive a tour and the next visit.
    page.keyboard.press("Escape")
    expect(panel).to_be_hidden()
    expect(page.locator("#loop")).to_have_attribute("aria-pressed", "false")
    page.locator("#colour-by").select_option("speed")

    page.goto("/health")
    page.goto(address)
    expect(page.locator("#colour-by")).to_have_value("speed")
    page.wait_for_function("() => foldback.player.playhead.frame > 5")
    expect(panel).to_be_hidden()


def test_first_tour_stands_still_for_reduced_motion_and_ends_by_a_tap(
    visit: Visit, wrench: str
) -> None:
    page = visit(f"/folds/{wrench}", view=False, toured=False, width=390, height=844)
    panel = page.locator("#tour-panel")
    expect(page.locator("#tour-run")).to_have_text("Play")
    expect(page.locator("#r-frame")).to_have_text(re.compile("^Frame 1 of"))
    page.locator("#tour-after").click()
    expect(page.locator("#tour-count")).to_have_text(re.compile("^2 of"))
    page.locator(".surface").click(position={"x": 20, "y": 120})
    expect(panel).to_be_hidden()
    page.locator("#tour").click()
    expect(panel).to_be_visible()
    expect(page.locator("#tour-hint")).to_be_hidden()
    row = page.locator("#tour-panel > .tour-ways")
    tops = row.evaluate("row => [...row.querySelectorAll('button')].map((b) => b.offsetTop)")
    assert len(set(tops)) == 1  # the buttons fit in one row
    page.locator(".surface").click(position={"x": 20, "y": 120})  # only the first tour ends so
    expect(panel).to_be_visible()
