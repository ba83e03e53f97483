"""The gallery, the paper and the API, and pages without scripts."""

import re

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import WIDTH, Visit, overflowing


def visible_cards(page: Page) -> list[str]:
    return page.locator("#cards li:visible .card-title").all_text_contents()


def test_gallery_is_filtered_by_form_and_address(visit: Visit) -> None:
    page = visit("/gallery", width=390, height=640, view=False)
    everything = len(visible_cards(page))
    expect(page.locator("#found")).to_have_text(f"{everything} shapes")
    page.get_by_text("Letters", exact=True).click()
    letters = visible_cards(page)
    assert 0 < len(letters) < everything
    assert all(title.startswith("Letter") for title in letters)
    page.get_by_label("At most").fill("90")
    expect(page).to_have_url(re.compile(r"\?most=90&kind=letter$"))
    few_visible_cards = visible_cards(page)
    assert 0 < len(few_visible_cards) < len(letters)
    expect(page.locator("#found")).to_have_text(f"{len(few_visible_cards)} of {everything} shapes")
    page.get_by_role("searchbox").fill("letter T")
    expect(page).to_have_url(re.compile("q=letter"))
    page.reload()
    assert visible_cards(page) == ["Letter T"]
    drawn = page.locator("#cards li:visible img").first
    assert drawn.evaluate("image => image.decode().then(() => image.naturalWidth)") > 0
    page.get_by_role("searchbox").fill("letter t elephant")
    expect(page.locator("#nothing")).to_be_visible()
    page.get_by_role("link", name="Show all").click()
    expect(page).to_have_url(re.compile("/gallery$"))
    expect(page.locator("#cards li:visible")).to_have_count(everything)
    assert overflowing(page) == {}
    # A shape that has not been folded opens in another tab: its preview, and nothing is folded.
    card = page.locator("#cards a:not([data-fold])").first
    with page.context.expect_page() as opened:
        card.click(modifiers=["Control"])
    expect(opened.value).to_have_url(re.compile("/previews/"))
    expect(opened.value.locator("#fold")).to_be_enabled()


@pytest.mark.long
def test_gallery_and_paper_work_without_scripts(visit: Visit) -> None:
    page = visit("/paper", java_script_enabled=False)
    expect(page.locator(".run img").first).to_be_visible()
    expect(page.locator("table").first).to_be_visible()
    expect(page.locator(".run-start").first).to_be_hidden()
    page.goto("/gallery")
    page.get_by_role("searchbox").fill("dodecahedron")
    page.get_by_role("button", name="Show", exact=True).click()
    assert visible_cards(page) == ["Rhombic dodecahedron"]
    page.get_by_role("link", name=re.compile("dodecahedron")).click()
    page.get_by_role("button", name="Fold this shape").click()
    page.wait_for_url(re.compile("/folds/[a-z0-9]+$"))
    expect(page.locator("h1")).to_have_text("Rhombic dodecahedron")


@pytest.mark.long
def test_paper_film_plays_scrubs_and_shows_its_tangle(visit: Visit) -> None:
    page = visit("/paper")
    films: list[str] = []
    page.on("request", lambda request: films.append(request.url.partition("/paper/")[2]))
    run = page.locator("#direct .run:has(.run-where)").first
    # With reduced motion nothing plays by itself, and nothing is loaded.
    assert not [name for name in films if name.endswith("/batch")]

    run.scroll_into_view_if_needed()
    run.locator(".run-start").click()
    run.locator(".run-view.moving").wait_for()
    page.wait_for_function("() => foldback.player.is.playing && foldback.player.snapshot.frame > 1")
    run.locator(".run-toggle").press(" ")
    page.wait_for_function("() => !foldback.player.is.playing")
    run.locator(".run-scrub").press("Home")
    expect(run.locator(".run-now")).to_contain_text("Playback")

    run.locator(".run-where").click()
    stuck = int(run.get_attribute("data-stuck-frame") or 0)
    page.wait_for_function(f"() => foldback.player.snapshot.frame === {stuck}")
    marked = page.evaluate("() => foldback.player.marked.join(' ')")
    assert marked == run.get_attribute("data-stuck")

    page.locator("#direct .run:not(:has(.run-where)) .run-start").first.click()
    expect(page.locator(".run canvas")).to_have_count(1)
    expect(run.locator(".run-start")).to_be_visible()
    batches = [name for name in films if name.endswith("/batch")]
    assert len(batches) == len(set(batches)) == 2


def test_first_paper_film_plays_while_visible(visit: Visit) -> None:
    page = visit("/paper", width=390, height=844, reduced_motion="no-preference")
    page.wait_for_function("() => foldback.player.is.playing")
    page.locator("#differences").scroll_into_view_if_needed()
    page.wait_for_function("() => !foldback.player.is.playing")
    page.locator("h1").scroll_into_view_if_needed()
    page.wait_for_function("() => foldback.player.is.playing")
    assert page.evaluate(WIDTH) <= 390
