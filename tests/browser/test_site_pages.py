"""The gallery, the paper and the API, and pages without scripts."""

from __future__ import annotations

import re
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import WIDTH, Visit
from tests.server.service import Service


def shown(page: Page) -> list[str]:
    return page.locator("#cards li:visible .card-title").all_text_contents()


def test_gallery_is_filtered_by_form_and_address(visit: Visit) -> None:
    page = visit("/", width=1000, height=640, view=False)
    page.get_by_role("link", name=re.compile(r"All \d+ shapes")).click()
    page.wait_for_url("**/gallery")  # also until all of it is there
    everything = len(shown(page))
    expect(page.locator("#found")).to_have_text(f"{everything} shapes")
    drawn = page.locator("#cards li:visible img").first
    assert drawn.evaluate("image => image.decode().then(() => image.naturalWidth)") > 0
    page.get_by_text("Letters", exact=True).click()
    letters = shown(page)
    assert 0 < len(letters) < everything
    assert all(title.startswith("Letter") for title in letters)
    page.get_by_label("At most").fill("90")
    expect(page).to_have_url(re.compile(r"\?kind=letter&modules=-90$"))
    few = shown(page)
    assert 0 < len(few) < len(letters)
    expect(page.locator("#found")).to_have_text(f"{len(few)} of {everything} shapes")
    page.get_by_role("searchbox").fill("letter T")
    expect(page).to_have_url(re.compile("q=letter"))
    assert shown(page) == ["Letter T"]
    page.reload()
    assert shown(page) == ["Letter T"]
    page.get_by_role("searchbox").fill("letter t elephant")
    expect(page.locator("#nothing")).to_be_visible()
    page.get_by_role("link", name="Show all").click()
    assert len(shown(page)) == everything
    expect(page).to_have_url(re.compile("/gallery$"))
    for width in (1440, 820, 390):
        page.set_viewport_size({"width": width, "height": 640})
        assert page.evaluate(WIDTH) <= width


@pytest.mark.long
def test_gallery_card_folds_its_shape_then_links_the_fold(visit: Visit, service: Service) -> None:
    page = visit(
        "/gallery?type=tetrahedron&modules=-12", width=390, height=844, view=False, has_touch=True
    )
    assert shown(page) == ["Ring of twelve"]
    card = page.get_by_role("button", name=re.compile("Ring of twelve.*Not folded yet"))
    card.focus()
    page.keyboard.press("Enter")
    page.wait_for_url(re.compile("/folds/[a-z0-9]+$"))
    fold = page.url.rpartition("/")[2]
    assert page.evaluate(f"localStorage.getItem('foldback:owner:{fold}')")
    service.wait_over(fold)
    page.goto("/gallery?status=verified")
    assert "Ring of twelve" in shown(page)
    page.get_by_role("link", name=re.compile("Ring of twelve.*Verified")).tap()
    expect(page.locator("#verdict")).to_have_attribute("data-tone", "good")
    assert page.url.endswith(fold)


@pytest.mark.long
def test_gallery_works_without_scripts(visit: Visit) -> None:
    page = visit("/gallery", java_script_enabled=False)
    page.get_by_role("searchbox").fill("dodecahedron")
    page.get_by_role("button", name="Show", exact=True).click()
    assert shown(page) == ["Rhombic dodecahedron"]
    page.get_by_role("button", name=re.compile("dodecahedron")).click()
    page.wait_for_url(re.compile("/folds/[a-z0-9]+$"))
    expect(page.locator("h1")).to_have_text("Rhombic dodecahedron")


FRAME = "() => foldback.player.shown?.frame"


def asked_for(page: Page) -> list[str]:
    """Films that were asked for from now on."""
    found: list[str] = []
    page.on("request", lambda request: found.append(request.url.partition("/paper/")[2]))
    return found


@pytest.mark.long
def test_paper_film_plays_scrubs_and_shows_its_tangle(visit: Visit) -> None:
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

    other = page.locator("#direct .run:not(:has(.run-where))").first
    other.locator(".run-start").click()
    other.locator(".run-view.moving").wait_for()
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


def test_paper_without_scripts_shows_stills_and_tables(visit: Visit) -> None:
    page = visit("/paper", java_script_enabled=False)
    expect(page.locator(".run img").first).to_be_visible()
    expect(page.locator("table").first).to_be_visible()
    expect(page.locator(".run-start").first).to_be_hidden()


DARK = "(dark) => document.documentElement.classList.contains('dark-mode') === dark"


@pytest.mark.long
def test_api_page_loads_nothing_from_other_origins(visit: Visit) -> None:
    page = visit("/", view=False, width=1440, height=844, color_scheme="light")
    said: list[str] = []
    origins: set[str] = set()
    page.on("console", lambda message: said.append(message.text))
    page.on("request", lambda request: origins.add(urlsplit(request.url).netloc))
    page.get_by_role("link", name="API", exact=True).click()
    described = page.request.get("/api/openapi.json").json()
    count = sum(len(ways) for ways in described["paths"].values())
    expect(page.locator(".opblock")).to_have_count(count)
    assert not said
    assert origins - {""} == {urlsplit(page.url).netloc}
    for width, scheme in ((1440, "light"), (390, "dark")):
        page.set_viewport_size({"width": width, "height": 844})
        page.emulate_media(color_scheme=scheme)
        page.wait_for_function(DARK, arg=scheme == "dark")
        assert page.evaluate(WIDTH) <= width
