"""The landing page: a visitor folds the chain by a slider."""

from playwright.sync_api import expect

from tests.browser.conftest import Visit, drag

FOLDED = "() => foldback.timeline.folded(foldback.player.snapshot)"
PLAYING = "() => foldback.player.is.playing"


def test_slider_folds_the_chain_and_ends_the_animation(visit: Visit) -> None:
    page = visit("/", width=390, height=844, reduced_motion="no-preference")
    slider, hint = page.get_by_label("Folded"), page.locator("#hero-hint")
    page.wait_for_function("() => foldback?.player.playhead.frame > 1")
    expect(hint).to_be_visible()
    box = slider.bounding_box()
    assert box is not None and box["width"] > 200
    y = box["y"] + box["height"] / 2
    drag(page, (box["x"] + 20, y), (box["x"] + box["width"] / 2, y))
    page.wait_for_function(f"() => Math.abs(({FOLDED})() - 0.5) < 0.03")
    assert not page.evaluate(PLAYING)
    expect(hint).to_be_hidden()
    expect(slider).to_have_attribute("aria-valuetext", "50 %")
    slider.press("PageUp")
    expect(slider).to_have_attribute("aria-valuetext", "60 %")
    page.wait_for_function(f"() => Math.abs(({FOLDED})() - 0.6) < 0.03")
    page.get_by_role("button", name="Play the animation").click()
    page.wait_for_function(PLAYING)

    # A card moves while it is pointed at.
    card = page.locator("[data-shape=wrench-24]")
    card.hover()
    moving = card.locator("img:visible[src$='/shapes/wrench-24/motion.svg']")
    expect(moving).to_have_count(1)
    expect(card.locator("img:visible")).to_have_count(1)
    page.mouse.move(5, 5)
    expect(card.locator("img")).to_have_count(1)
    expect(card.locator("img:visible")).to_have_count(1)


def test_nothing_moves_on_the_landing_page_with_reduced_motion(visit: Visit) -> None:
    page = visit("/")
    slider = page.get_by_label("Folded")
    expect(slider).to_be_enabled()
    expect(slider).to_have_attribute("aria-valuetext", "100 %")
    assert not page.evaluate(PLAYING)
    slider.press("Home")
    page.wait_for_function(f"() => ({FOLDED})() < 0.01")
    page.locator("[data-shape=wrench-24]").hover()
    page.wait_for_timeout(300)  # longer than a card is pointed at before it moves
    expect(page.locator("[data-shape=wrench-24] img")).to_have_count(1)
