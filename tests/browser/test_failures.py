"""Failed folds: the reason in words, the frame of the failure, and the stalled modules."""

import json
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from foldback import foldback_check_exhaustion, foldback_check_refusals
from tests.browser.conftest import (
    Visit,
    picture,
    shown_frame,
    wait_for_fold,
    wait_for_view,
)
from tests.planner.pathfinding.test_knots import OVERHAND, walk
from tests.server.service_process import Service

pytestmark = pytest.mark.long
TAIL = 20
LAPTOP = {"width": 960, "height": 440, "color_scheme": "light"}
HIGHLIGHTED = """() => {
  const { player } = window.foldback;
  const stuck = player.timeline.bundle.header.colours.stuck;
  const colours = player.colours();
  const is = (i) => stuck.every((v, c) => colours[3 * i + c] === v);
  return Array.from({ length: colours.length / 3 }, (_, i) => i).filter(is);
}"""


def show_stuck_modules(page: Page) -> list[int]:
    """Show where the fold stalled, and return the modules that are highlighted there."""
    if not page.locator("#stuck-more").is_visible():
        page.locator("#stuck-fold").click()
    page.locator("#stuck-go").click()
    seen_picture = picture(page)
    highlighted_modules = page.evaluate(HIGHLIGHTED)
    orange = (seen_picture[..., 0] > 120) & (seen_picture[..., 0] - seen_picture[..., 2] > 90)
    assert (orange & (seen_picture[..., 1] > 0.35 * seen_picture[..., 0])).sum() > 400
    return highlighted_modules


def test_impossible_module_size_fails_with_overlap(visit: Visit, service: Service) -> None:
    options = {"module_size": 1.0, "strategy": "simultaneous"}
    fold = service.fold(shape="wrench-80", **options)["id"]
    state = service.wait_over(fold)
    assert state["status"] == "failed"
    place = state["summary"]["certificate"]["min_clearance_at"]
    page = wait_for_view(visit(f"/folds/{fold}", **LAPTOP))
    expect(page.locator("#stuck-heading")).to_have_text("Modules overlap")
    expect(page.locator("#stuck-text")).to_contain_text("In the plan, modules")
    assert show_stuck_modules(page) == sorted(place["modules"])
    explosion = state["summary"]["explosion"]["frames"]
    existing_shown_frame = shown_frame(page)
    assert existing_shown_frame == pytest.approx(explosion + place["frame"], abs=1)
    # The verdict and the menu lead to the same place.
    for lead in (
        lambda: page.locator("#verdict-go").click(),
        lambda: page.locator("#jump").select_option("min_clearance"),
    ):
        page.locator("#folded").fill("0")
        lead()
        expect(page.locator("#scrub")).to_have_value(str(existing_shown_frame))
    page.locator("#stuck-attempts").click()
    expect(page.locator(".attempts li")).to_have_count(4)
    expect(page.locator(".attempts li").first).to_contain_text("All at once")
    expect(page.locator(".attempts li").first).to_contain_text("overlap")
    page.locator("#panel-attempts .inline").first.click()
    expect(page.locator("#panel-module h2")).to_contain_text(f"Module {place['modules'][0] + 1} ")
    expect(page.locator("#again")).to_contain_text("Try the default module size")


def test_knot_is_drawn_located_and_confirmed(
    visit: Visit, service: Service, tmp_path: Path
) -> None:
    corners = [(-TAIL, 0, 0), *OVERHAND[1:-1], (4, 6 + TAIL, 2)]
    # Simultaneous release would loosen the knot; peeling tightens it.
    fold = service.fold(walk(tuple(corners)).tolist(), strategy="peel")["id"]
    state = service.wait_over(fold)
    assert (state["status"], state["summary"]["stuck"]["kind"]) == ("failed", "knot")
    page = wait_for_view(visit(f"/folds/{fold}", **LAPTOP))
    expect(page.locator("#stuck-heading")).to_have_text("The chain is knotted")
    drawn = page.locator("#stuck-knot svg")
    assert drawn.get_attribute("aria-label") == "A knot with 3 crossings, determinant 3"
    assert drawn.locator("path").count() == 3
    stuck_modules = show_stuck_modules(page)
    assert stuck_modules == state["summary"]["stuck"]["modules"]
    # The knot is in the middle, between the tails.
    assert min(stuck_modules) > TAIL and max(stuck_modules) < len(walk(tuple(corners))) - TAIL
    assert shown_frame(page) == page.evaluate("() => window.foldback.timeline.last")
    page.locator("#stuck-attempts").click()
    locator = page.locator(".attempts li")
    expect(locator).to_have_count(1)  # peeling has only one variant here
    expect(locator).to_contain_text("the knot's determinant is 3; that of a chain without a")
    # Both files are offered, and suffice to confirm the reason.
    expect(page.locator("#attempts code")).to_contain_text("_refusals.py plan.npz record.npz")
    for name in ("plan.npz", "record.npz"):
        link = page.locator(f"#attempts a[download='{name}']").get_attribute("href")
        (tmp_path / name).write_bytes(service.http.get(str(link)).content)
    stuck_modules = foldback_check_refusals.check(tmp_path / "plan.npz", tmp_path / "record.npz")
    assert stuck_modules["verdict"] == "refusal confirmed", stuck_modules


NOTE_COVERS = """addEventListener("DOMContentLoaded", () => {
  const cover = document.getElementById("cover");
  if (!cover) return;
  window.covers = [];
  const note = () => window.covers.push(document.getElementById("cover-button").hidden);
  note();
  new MutationObserver(note).observe(
    cover, { subtree: true, childList: true, attributes: true });
});"""
"""Records whether the cover of a fold ever offers an action."""


def test_failed_baseline_offers_the_default_preset(visit: Visit) -> None:
    page = visit("/", script=NOTE_COVERS)
    page.locator("details.options > summary").click()
    page.locator("#preset").select_option(label="Joints turned directly (usually fails)")
    page.locator("[data-shape=wrench-80]").click()
    wait_for_fold(page)
    expect(page.locator("#verdict")).to_have_attribute("data-tone", "bad")
    page.reload()
    page.locator("#sketch.gone").wait_for(state="attached")
    assert page.evaluate("window.covers.every((hidden) => hidden)")
    before = page.url
    page.locator("#again", has_text="Try foldback’s own method").click()
    page.wait_for_url(lambda url: "/folds/" in url and url != before)
    expect(page.locator("#verdict")).to_have_attribute("data-tone", "good")


def test_fold_without_turns_names_the_largest_size(visit: Visit, service: Service) -> None:
    chain = {"format": "foldback-chain/1", "module": "snake-prism"}
    locked = json.dumps({**chain, "joint_angles_deg": [0, 180, 180, 0]})
    options = {"module_size": 0.9, "strategy": "turns"}
    fold = service.upload("locked.json", locked, **options).json()["id"]
    assert service.wait_over(fold)["status"] == "failed"
    page = wait_for_view(visit(f"/folds/{fold}", **LAPTOP))
    expect(page.locator("#stuck-size")).to_contain_text("only for prisms of up to 0.8062")
    page.locator("#details").click()
    expect(page.locator("#full-size")).to_contain_text("No sequence of single quarter turns")
    expect(page.locator("#full-size")).to_contain_text("of at most 0.8062 of the full size")
    with page.expect_download() as proof:
        page.get_by_role("link", name="Download the proof").click()
    assert foldback_check_exhaustion.check(str(proof.value.path()))["verdict"] == "proved"
