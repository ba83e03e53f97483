"""The gallery, as a visitor meets it: sifted, shared, folded from, and without a script."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import keep
from tests.server.service import Service

pytestmark = [pytest.mark.browser, pytest.mark.slow]
Visit = Callable[..., Page]


def shown(page: Page) -> list[str]:
    return page.locator("#cards li:visible .card-title").all_text_contents()


def test_it_is_sifted_and_the_address_says_how(visit: Visit) -> None:
    page = visit("/", width=1440, height=900)
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
    keep(page, "gallery-empty-1440x900")
    page.get_by_role("link", name="Show all").click()
    assert len(shown(page)) == everything
    expect(page).to_have_url(re.compile("/gallery$"))


@pytest.mark.long
def test_a_card_folds_its_shape_and_then_shows_the_fold(visit: Visit, service: Service) -> None:
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
def test_it_works_without_a_script(visit: Visit) -> None:
    page = visit("/gallery", java_script_enabled=False)
    page.get_by_role("searchbox").fill("dodecahedron")
    page.get_by_role("button", name="Show", exact=True).click()
    assert shown(page) == ["Rhombic dodecahedron"]
    page.get_by_role("button", name=re.compile("dodecahedron")).click()
    page.wait_for_url(re.compile("/folds/[a-z0-9]+$"))
    expect(page.locator("h1")).to_have_text("Rhombic dodecahedron")


def test_nothing_is_wider_than_the_page(visit: Visit) -> None:
    page = visit("/gallery", width=1440, height=900)
    for width in (1440, 820, 390):
        page.set_viewport_size({"width": width, "height": 900})
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        keep(page, f"gallery-{width}")
