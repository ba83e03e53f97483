"""A fold's page proves the clearance in the visitor's browser, and is broken on purpose."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from foldback_check import Plan
from planner.motion.timeline import Timeline
from tests.browser.conftest import Visit, visits
from tests.browser.test_accessibility import findings
from tests.server.service import Service

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture(scope="module")
def page(service: Service, wrench: str) -> Iterator[Page]:
    with visits(service) as visit:
        page = visit(f"/folds/{wrench}", width=1366, height=768, view=False)
        page.wait_for_function("() => window.foldback?.timeline.complete")
        page.locator("#details").click()
        yield page


def test_the_browser_checks_a_fold_by_itself(page: Page, service: Service, wrench: str) -> None:
    check = page.locator("#check")
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    check.get_by_role("button", name="Check it here").click()
    said = check.get_by_role("status")
    expect(said).to_contain_text("Checked by this browser, without our server: 24 modules")
    claim = Plan(service.directory(wrench) / "plan.npz").claim
    assert f"{int(1000 * claim) / 10:.1f} % of a module width apart" in said.inner_text()
    assert [url for url in asked if url.endswith("/plan.npz")]
    expect(check.get_by_text("Makes modules larger")).to_be_in_viewport()
    expect(check.get_by_role("button", name="Check it here")).to_be_focused()
    check.get_by_text("What is not claimed").click()
    expect(check).to_contain_text("Real joints have play")
    assert findings(page) == {}


def test_its_tightest_place_is_shown(page: Page, service: Service, wrench: str) -> None:
    check = page.locator("#check")
    check.get_by_role("button", name="Tightest place").click()
    frames = len(Timeline.open(service.directory(wrench) / "timeline.zarr").frames())
    plan = Plan(service.directory(wrench) / "plan.npz").frames
    shown = page.locator("#r-frame").inner_text()
    found = re.match(r"Frame (\d+) of", shown)
    assert found is not None
    assert frames - plan < int(found[1]) <= frames
    assert len(page.evaluate("foldback.player.marked")) == 2


def test_it_is_broken_on_purpose(page: Page) -> None:
    check = page.locator("#check")
    said = check.get_by_role("status")
    check.get_by_role("button", name="Larger modules").click()
    expect(said).to_contain_text("The modules of this plan are 95.0 % of a cell wide.")
    page.evaluate("foldback.player.send({ do: 'select', module: 12 })")
    page.locator("#tab-properties").click()
    check.get_by_role("button", name="Turn a hinge by 1°").click()
    expect(said).to_contain_text("With the joint behind module 13 off by 1°")


def test_the_checker_is_there_to_take_away(service: Service) -> None:
    answer = service.http.get("/static/foldback_check.py")
    assert answer.is_success
    assert "def main" in answer.text


def test_a_downloaded_page_checks_itself(
    visit: Visit, service: Service, wrench: str, tmp_path: Path
) -> None:
    file = tmp_path / "fold.html"
    file.write_bytes(service.http.get(f"/folds/{wrench}/standalone.html").content)
    page = visit("about:blank", width=1366, height=768, view=False, offline=True)
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(file.as_uri())
    page.locator("#details").click()
    check = page.locator("#check")
    check.get_by_role("button", name="Check it here").click()
    said = check.get_by_role("status")
    expect(said).to_contain_text("Checked by this browser, without our server: 24 modules")
    expect(said).to_contain_text(re.compile(r"It took [\d.]+ s"))
    check.get_by_role("button", name="Tightest place").click()
    assert len(page.evaluate("foldback.player.marked")) == 2
    expect(check.get_by_role("link")).to_have_count(0)
    assert [url for url in asked if url.startswith("http")] == []


def test_it_is_checked_where_it_is_embedded(visit: Visit, wrench: str) -> None:
    page = visit(f"/embed/{wrench}", width=640, height=420, view=False, color_scheme="light")
    page.wait_for_function("() => window.foldback?.timeline.complete")
    page.get_by_role("button", name="Check it here").click()
    dialog = page.get_by_role("dialog")
    expect(dialog.get_by_role("status")).to_contain_text("Checked by this browser")
    dialog.get_by_role("button", name="Tightest place").click()
    expect(dialog).to_have_count(0)
    assert len(page.evaluate("foldback.player.marked")) == 2


def test_either_of_two_folds_is_checked(visit: Visit, wrench: str) -> None:
    page = visit(f"/compare?a={wrench}&b={wrench}", width=1200, height=700, view=False)
    page.locator("#side-1").get_by_role("button", name="here").click()
    dialog = page.get_by_role("dialog")
    expect(dialog.get_by_role("status")).to_contain_text("Checked by this browser")
    dialog.get_by_role("button", name="Tightest place").click()
    expect(dialog).to_have_count(0)
    expect(page.locator("#r-phase")).to_have_text("Playback")


def test_it_is_checked_on_a_phone(visit: Visit, wrench: str) -> None:
    page = visit(f"/folds/{wrench}", width=390, height=760, view=False, color_scheme="light")
    page.wait_for_function("() => window.foldback?.timeline.complete")
    page.locator("#details").click()
    check = page.locator("#check")
    check.get_by_role("button", name="Check it here").click()
    expect(check.get_by_role("status")).to_contain_text("Checked by this browser")
    check.get_by_role("button", name="Turn a hinge by 1°").scroll_into_view_if_needed()
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
