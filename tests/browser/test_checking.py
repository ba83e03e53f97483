"""Fold pages: proof of the clearance in the visitor's browser, and changes that break it."""

import re
from pathlib import Path

from playwright.sync_api import Locator, expect

from foldback.foldback_check import Plan
from foldback.planner.motion.timeline import Timeline
from tests.browser.conftest import WIDTH, Visit
from tests.server.service_process import FinishedFold


def check_in_page(check: Locator) -> Locator:
    """Have a fold checked in its page, and return the element with the result."""
    check.get_by_role("button", name="Check this plan").click()
    status = check.get_by_role("status")
    expect(status).to_contain_text("This browser checked 16 modules without our server")
    return status


def test_fold_is_checked_and_broken_on_purpose(visit: Visit, finished: FinishedFold) -> None:
    page = visit(finished.page, width=390, height=760, view=False)
    page.wait_for_function("() => window.foldback?.timeline.complete")
    page.locator("#verdict-check").click()
    check = page.locator("#check")
    urls: list[str] = []
    page.on("request", lambda request: urls.append(request.url))
    status = check_in_page(check)
    plan = Plan(finished.directory / "plan.npz")
    assert f"{int(1000 * plan.claim) / 10:.1f} % of the spacing apart" in status.inner_text()
    assert [url for url in urls if url.endswith("/plan.npz")]
    expect(check.get_by_role("button", name="Check this plan")).to_be_focused()
    check.get_by_text("What this check does not show").click()
    expect(check).to_contain_text("Real joints are slightly loose")
    assert "def main" in finished.http.get("/static/foldback_check.py").text
    assert page.evaluate(WIDTH) <= 390

    check.get_by_role("button", name="Larger modules").click()
    expect(status).to_contain_text(re.compile(r"(fills|grow from) 95\.0 %"))
    page.evaluate("foldback.player.send({ do: 'select', module: 12 })")
    page.locator("#tab-properties").click()
    check.get_by_role("button", name="Turn a hinge by 1°").click()
    expect(status).to_contain_text("If the joint between modules 13 and 14 is off by 1°")

    check_in_page(check)
    check.get_by_role("button", name="Tightest place").click()
    frames = len(Timeline.open(finished.directory / "timeline").frames())
    match = re.match(r"Frame (\d+) of", page.locator("#r-frame").inner_text())
    assert match and frames - plan.frames < int(match[1]) <= frames
    assert len(page.evaluate("foldback.player.marked")) == 2


def test_downloaded_page_checks_itself(
    visit: Visit, finished: FinishedFold, tmp_path: Path
) -> None:
    file = tmp_path / "fold.html"
    file.write_bytes(finished.http.get(f"{finished.page}/standalone.html").content)
    page = visit("about:blank", width=1366, height=768, view=False, offline=True)
    urls: list[str] = []
    page.on("request", lambda request: urls.append(request.url))
    page.goto(file.as_uri())
    page.locator("#details").click()
    check = page.locator("#check")
    expect(check_in_page(check)).to_contain_text(re.compile(r"The check took [\d.]+ s"))
    check.get_by_role("button", name="Tightest place").click()
    assert len(page.evaluate("foldback.player.marked")) == 2
    expect(check.get_by_role("link")).to_have_count(0)
    assert [url for url in urls if url.startswith("http")] == []


def test_embedded_fold_is_checked_in_a_dialog(visit: Visit, finished: FinishedFold) -> None:
    page = visit(f"/embed/{finished.id}", width=640, height=420, view=False)
    page.wait_for_function("() => window.foldback?.timeline.complete")
    page.get_by_role("button", name="Check this plan").click()
    dialog = page.get_by_role("dialog")
    expect(dialog.get_by_role("status")).to_contain_text("This browser checked")
    dialog.get_by_role("button", name="Tightest place").click()
    expect(dialog).to_have_count(0)
    assert len(page.evaluate("foldback.player.marked")) == 2
