"""Waiting: the remaining time of a fold; cancelled uploads and movies."""

import json
import re

import pytest
from playwright.sync_api import expect

from tests.browser.conftest import WIDTH, Visit, choose, keep_as_mine, open_tab, wait_until
from tests.browser.test_accessibility import findings
from tests.planner.chain.test_module_checks import RANGE, changed, document
from tests.server.service_process import Service, owner

SLOW = {"offline": False, "latency": 0, "downloadThroughput": -1, "uploadThroughput": 80_000}
"""Network conditions; throughput in bytes/s."""
NOTE_VERDICTS = """addEventListener("DOMContentLoaded", () => {
  window.heard = [];
  const verdict = document.getElementById("verdict");
  const note = () => window.heard.push(verdict.textContent);
  new MutationObserver(note).observe(verdict, { childList: true });
});"""


DROP = """([text, name]) => {
  const files = new DataTransfer();
  files.items.add(new File([text], name, { type: "application/json" }));
  const zone = document.getElementById("drop");
  for (const kind of ["dragenter", "dragover", "drop"])
    zone.dispatchEvent(
      new DragEvent(kind, { dataTransfer: files, bubbles: true, cancelable: true }));
}"""


def test_upload_shows_progress_and_is_stopped(visit: Visit, service: Service) -> None:
    page = visit("/", view=False)
    page.evaluate(DROP, ["[[0, 0, 0], [1, 0, 0], [0, 0, 0]]", "bad.json"])
    expect(page.locator("#drop-message")).to_contain_text("Cells 1 and 3")
    network = page.context.new_cdp_session(page)
    network.send("Network.emulateNetworkConditions", SLOW)
    choose(page, "large.stl", bytes(8_000_000))
    sending = page.locator(".sending")
    expect(sending).to_contain_text(re.compile(r"Sending large\.stl: \d+ %, \d\.\d MB of 8\.0 MB"))
    bar = sending.get_by_role("progressbar", name="Sending large.stl")
    assert 0.0 < float(bar.get_attribute("value") or 0.0) < 1.0
    sending.get_by_role("button", name="Stop").click()
    expect(page.locator("#drop-message")).to_have_text("Stopped")
    expect(sending).to_have_count(0)
    wait_until(page, lambda: not any(service.data_dir.glob("uploads/*/*")))
    network.detach()


def test_module_file_is_checked_and_offered(visit: Visit) -> None:
    page = visit("/", view=False)
    message, offer = page.locator("#drop-message"), page.locator("#drop-offer")
    page.evaluate(DROP, [json.dumps(changed((RANGE, None))), "free.json"])
    expect(message).to_contain_text("collide at 9")
    expect(offer).to_be_hidden()
    page.evaluate(DROP, [json.dumps(document()), "slab.json"])
    expect(message).to_contain_text("no faults")
    expect(message).to_have_attribute("data-tone", "")
    expect(offer).to_have_text("Show the module")


@pytest.mark.long
def test_time_left_is_shown_and_movie_is_stopped(visit: Visit, service: Service) -> None:
    for seed in ("31", "32"):  # so that durations of similar folds are known
        service.wait_over(service.fold(shape="wrench-24", seed=seed)["id"])
    ahead = service.fold(shape="mallet-160", seed="31")
    fold = service.fold(shape="wrench-160", seed="31")
    page = visit(f"/folds/{fold['id']}", view=False, script=NOTE_VERDICTS)
    expect(page.locator("#verdict")).to_have_attribute("data-tone", "good")
    verdicts = page.evaluate("window.heard")
    remaining_pattern = re.compile(
        "· (about [0-9]+ (s|min) left|a few seconds left|takes longer than usual|slow, because .*)"
    )
    assert any(remaining_pattern.search(text) for text in verdicts), verdicts
    service.wait_over(ahead["id"])

    open_tab(page, "downloads")
    page.get_by_text("All files", exact=True).click()
    page.locator("[name=size]").select_option("1920x1080")
    page.locator("[name=seconds]").select_option("20")
    page.get_by_role("button", name="Create movie").click()
    state = page.locator(".movie-state").first
    expect(state).to_have_text(re.compile("Picture [0-9]+ of 600"))
    stop = page.locator("#panel-downloads").get_by_role("button", name="Stop")
    assert findings(page) == {}
    stop.click()
    expect(state).to_have_text("Stopped")
    expect(page.get_by_role("button", name="Create movie")).to_be_enabled()
    assert service.http.delete(f"/api/folds/{fold['id']}", headers=owner(fold)).status_code == 204


@pytest.mark.long
def test_cancelling_is_shown_until_it_is_done(visit: Visit, service: Service) -> None:
    page = visit("/shapes/new")
    fold = service.fold(shape="mallet-192", seed="11", preset="paper")
    keep_as_mine(page, fold)
    page.goto(f"/folds/{fold['id']}")
    page.locator("#cancel").wait_for()
    assert findings(page) == {}
    page.set_viewport_size({"width": 390, "height": 844})
    page.evaluate(
        """window.said = [];
        const verdict = document.getElementById("verdict");
        new MutationObserver(() => said.push(verdict.textContent))
          .observe(verdict, { childList: true, characterData: true, subtree: true });
        document.getElementById("cancel").addEventListener(
          "click", () => { window.said = []; }, { capture: true });"""
    )
    page.locator("#cancel").click()
    expect(page.locator("#verdict")).to_have_text("Cancelled before it finished")
    assert set(page.evaluate("window.said")) == {"Cancelling…", "Cancelled before it finished"}
    expect(page.get_by_role("button", name="Fold again")).to_be_visible()
    expect(page.locator("#stuck")).to_be_hidden()
    assert page.evaluate(WIDTH) <= 390
