"""Details: keys, messages and covers."""

import re

import pytest
from playwright.sync_api import expect

from tests.browser.conftest import WIDTH, Visit, keep_as_mine, wait_for_fold
from tests.browser.test_accessibility import findings
from tests.server.service_process import Service

pytestmark = pytest.mark.long


def test_escape_closes_the_details_and_restores_focus(visit: Visit, wrench: str) -> None:
    page = visit(f"/folds/{wrench}")
    page.locator("#details").click()
    page.locator("#sketch.gone").wait_for(state="attached")
    view = page.locator("#view").bounding_box()
    page.mouse.click(view["x"] + 20, view["y"] + 60)  # the view has the focus now
    page.keyboard.press("Escape")
    expect(page.locator("#drawer")).to_be_hidden()
    expect(page.locator("#details")).to_be_focused()
    expect(page.locator("#details")).to_have_attribute("aria-expanded", "false")


NOTE_COVERS = """addEventListener("DOMContentLoaded", () => {
  const cover = document.getElementById("cover");
  if (!cover) return;
  window.covers = [];
  const note = () => window.covers.push(document.getElementById("cover-button").hidden);
  note();
  new MutationObserver(note).observe(
    cover, { subtree: true, childList: true, attributes: true });
});"""
"""Notes whether the cover of a fold ever offers an action."""


def test_failed_baseline_offers_the_default_preset(visit: Visit) -> None:
    page = visit("/", script=NOTE_COVERS)
    page.locator("details.options > summary").click()
    page.locator("#preset").select_option(label="Direct servoing (usually fails)")
    page.locator("[data-shape=wrench-80]").click()
    wait_for_fold(page)
    expect(page.locator("#verdict")).to_have_attribute("data-tone", "bad")
    page.reload()
    page.locator("#sketch.gone").wait_for(state="attached")
    assert page.evaluate("window.covers.every((hidden) => hidden)")
    before = page.url
    page.locator("#again", has_text="Try with the default preset").click()
    page.wait_for_url(lambda url: "/folds/" in url and url != before)
    expect(page.locator("#verdict")).to_have_attribute("data-tone", "good")


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


def test_typed_chain_folds_and_names_a_wrong_character(visit: Visit) -> None:
    page = visit("/", view=False)
    page.locator("#type").click()
    expect(page.locator("#angles")).to_be_focused()
    page.locator("#angles").fill("0 - x +")
    page.locator("#typed").click()
    expect(page.locator("#drop-message")).to_contain_text("Character 5")
    page.locator("#angles").fill("- - - + - - - + - - -")
    page.keyboard.press("Enter")
    wait_for_fold(page)
    expect(page.locator("#verdict")).to_have_text(re.compile(r"^Verified .* · 12\smodules$"))
