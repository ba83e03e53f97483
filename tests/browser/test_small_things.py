"""Small things that a visitor meets: keys, words, covers."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect

from tests.browser.conftest import WIDTH, Visit, choose, opened_fold
from tests.server.service import Service, owner

pytestmark = pytest.mark.long


def test_escape_closes_the_details_and_restores_focus(visit: Visit, wrench: str) -> None:
    page = visit(f"/folds/{wrench}")
    page.locator("#details").click()
    page.locator("#tab-properties").click()
    expect(page.locator("#drawer")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.locator("#drawer")).to_be_hidden()
    expect(page.locator("#details")).to_be_focused()
    expect(page.locator("#details")).to_have_attribute("aria-expanded", "false")
    page.locator("#details").click()
    page.locator("#sketch.gone").wait_for(state="attached")
    view = page.locator("#view").bounding_box()
    page.mouse.click(view["x"] + 20, view["y"] + 60)  # the focus is in the view now
    page.keyboard.press("Escape")
    expect(page.locator("#drawer")).to_be_hidden()
    expect(page.locator("#details")).to_be_focused()


def test_messages_are_sentences(visit: Visit) -> None:
    page = visit("/")
    choose(page, "bad.json", b"[[0, 0, 0], [1, 0")
    message = page.locator("#drop-message[data-tone=bad]")
    expect(message).to_contain_text(re.compile("[a-z]"))
    assert message.inner_text()[0].isupper()
    page.locator("details.options > summary").click()
    page.locator("#seed").evaluate("seed => { seed.value = 99999999999; }")
    page.locator("[data-shape=wrench-24]").click()
    expect(message).to_have_text(
        "Expected a whole number from 0 to 4294967295, but found the seed 99999999999."
    )
    expect(message).to_be_in_viewport()


NOTE_COVERS = """addEventListener("DOMContentLoaded", () => {
  const cover = document.getElementById("cover");
  if (!cover) return;
  window.covers = [];
  const note = () => window.covers.push(document.getElementById("cover-button").hidden);
  note();
  new MutationObserver(note).observe(
    cover, { subtree: true, childList: true, attributes: true });
});"""
"""Notes whether the cover of a fold ever offers anything."""


def test_failed_baseline_offers_the_default_preset(visit: Visit) -> None:
    page = visit("/", script=NOTE_COVERS)
    page.locator("details.options > summary").click()
    page.locator("#preset").select_option(label="Direct servoing (usually fails)")
    page.locator("[data-shape=wrench-80]").click()
    opened_fold(page)
    expect(page.locator("#verdict")).to_have_attribute("data-tone", "bad")
    page.reload()
    page.locator("#sketch.gone").wait_for(state="attached")
    assert page.evaluate("window.covers.every((hidden) => hidden)")
    page.locator("#details").click()
    page.locator("#tab-properties").click()
    expect(page.locator("#panel-properties")).to_contain_text("Direct servoing")
    label, value = (page.locator(f"#panel-properties .{part}").first for part in ("above", "below"))
    expect(label).to_have_text("Verdict")
    assert label.bounding_box()["y"] < value.bounding_box()["y"]  # type: ignore[index]
    page.locator("#drawer-close").click()
    before = page.url
    page.locator("#again", has_text="Try with the default preset").click()
    page.wait_for_url(lambda url: "/folds/" in url and url != before)
    expect(page.locator("#verdict")).to_have_attribute("data-tone", "good")


def test_cancelled_fold_without_frames_offers_to_fold_again(visit: Visit, service: Service) -> None:
    ahead = service.fold(shape="mallet-192", seed="4")
    fold = service.fold(shape="wrench-24", seed="4")
    for accepted in (fold, ahead):
        address = f"/api/folds/{accepted['id']}/cancel"
        assert service.http.post(address, headers=owner(accepted)).status_code == 202
    assert service.wait_over(fold["id"])["progress"]["frames"] == 0
    page = visit(f"/folds/{fold['id']}")
    expect(page.locator("#cover-other")).to_have_text("Start another")
    page.locator("#cover-button", has_text="Fold again").click()
    page.wait_for_url(lambda url: "/folds/" in url and fold["id"] not in url)
    expect(page.locator("#name")).to_have_text("Small wrench")
    expect(page.locator("#verdict")).to_have_attribute("data-tone", "good")


def test_cancelling_is_shown_until_it_is_done(visit: Visit, service: Service) -> None:
    page = visit("/shapes/new", width=390, height=844)
    fold = service.fold(shape="mallet-192", seed="11", preset="paper")
    page.evaluate(
        "([key, token]) => localStorage.setItem(key, token)",
        [f"foldback:owner:{fold['id']}", fold["owner_token"]],
    )
    page.goto(f"/folds/{fold['id']}")
    page.locator("#cancel").wait_for()
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
    assert page.locator("#jump option[value=stuck]").get_attribute("hidden") is not None
    assert page.evaluate(WIDTH) <= 390


def test_benchmarks_are_shown(visit: Visit) -> None:
    page = visit("/", width=390, height=844, view=False)
    page.locator(".foot a[href='/benchmarks']").click()
    expect(page.locator("h1")).to_have_text("Benchmarks")
    shown = page.locator(".telling-picture img")
    page.wait_for_function("() => document.querySelector('.telling-picture img').complete")
    assert shown.evaluate("(image) => image.naturalWidth") > 700
    box = shown.bounding_box()
    assert box and box["width"] >= 780  # its words are large enough; a phone scrolls it
    assert page.evaluate(WIDTH) <= 390
