"""The page of the API: drawn from our own origin, under the policy of all pages."""

from __future__ import annotations

from collections.abc import Callable
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Page, expect

pytestmark = pytest.mark.browser
DARK = "(dark) => document.documentElement.classList.contains('dark-mode') === dark"


@pytest.mark.long
def test_the_api_is_shown_without_another_origin(visit: Callable[..., Page]) -> None:
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
        assert page.evaluate("document.documentElement.scrollWidth") <= width
