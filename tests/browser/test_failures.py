"""Folds that came to nothing: the reason in words, how far they came, and where they stick."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

import foldback_check_refusals
from planner.motion.timeline import Timeline
from planner.pathfinding.assembly import layered_snake
from tests.browser.conftest import WIDTH, Visit, at_frame, picture, shown_frame, with_view
from tests.planner.pathfinding.test_knots import OVERHAND, walk
from tests.server.service import SPIRAL, Service, over

pytestmark = pytest.mark.long
TAIL = 20
LAPTOP = {"width": 960, "height": 440, "color_scheme": "light"}
LARGE = {"width": 1440, "height": 1000, "color_scheme": "light"}
"""For what is still packed when it stops: few modules that it sticks at are seen then."""
PHONE = {"width": 390, "height": 844, "has_touch": True}
ORANGE = """() => {
  const { player } = window.foldback;
  const stuck = player.timeline.bundle.header.colours.stuck;
  const colours = player.colours();
  const is = (i) => stuck.every((v, c) => colours[3 * i + c] === v);
  return Array.from({ length: colours.length / 3 }, (_, i) => i).filter(is);
}"""
INSIDE = """(modules) => {
  const { rig: { eye: { position, target }, pitch }, shown } = window.foldback.player;
  const far = (point) => Math.hypot(...point.map((v, k) => v - target[k])) / pitch;
  const place = (i) => [0, 1, 2].map((k) => shown.positions[3 * i + k] * pitch);
  return { nearest: Math.min(...modules.map((i) => far(place(i)))), distance: far(position) };
}"""


@pytest.fixture(scope="module")
def hasty(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service whose stages may take little time."""
    service = Service(tmp_path_factory.mktemp("hasty") / "data", stage_seconds=8).start()
    yield service
    assert service.stop() == 0


def looked_at(page: Page, name: str) -> list[int]:
    """Presses what shows where it sticks; the modules that are highlighted there."""
    if not page.locator("#stuck-more").is_visible():
        page.locator("#stuck-fold").click()
    page.locator("#stuck-go").click()
    seen = picture(page)
    found = page.evaluate(ORANGE)
    if found:
        orange = (seen[..., 0] > 120) & (seen[..., 0] - seen[..., 2] > 90)
        assert (orange & (seen[..., 1] > 0.35 * seen[..., 0])).sum() > 400
        near = page.evaluate(INSIDE, found)
        assert near["nearest"] < near["distance"] / 2
    return found


def test_direct_servoing_fails_with_overlap(visit: Visit, service: Service) -> None:
    fold = service.fold(SPIRAL, preset="direct")["id"]
    state = service.wait_over(fold)
    place = state["summary"]["certificate"]["min_clearance_at"]
    page = with_view(visit(f"/folds/{fold}", **LAPTOP))
    expect(page.locator("#stuck-heading")).to_have_text("Modules overlap")
    assert looked_at(page, "failure-direct") == sorted(place["modules"])
    assert shown_frame(page) == pytest.approx(place["frame"], abs=1)


def test_impossible_module_size_fails_with_overlap(visit: Visit, service: Service) -> None:
    asked = {"module_size": 1.0, "strategy": "simultaneous"}
    fold = service.fold(shape="wrench-80", **asked)["id"]
    state = service.wait_over(fold)
    assert state["status"] == "failed"
    place = state["summary"]["certificate"]["min_clearance_at"]
    page = with_view(visit(f"/folds/{fold}", **LAPTOP))
    expect(page.locator("#stuck-heading")).to_have_text("Modules overlap")
    expect(page.locator("#stuck-text")).to_contain_text("At a module size of 1, modules")
    assert looked_at(page, "failure-size") == sorted(place["modules"])
    explosion = state["summary"]["explosion"]["frames"]
    assert shown_frame(page) == pytest.approx(explosion + place["frame"], abs=1)
    page.locator("#stuck-attempts").click()
    expect(page.locator(".attempts li")).to_have_count(4)
    expect(page.locator(".attempts li").first).to_contain_text("All at once")
    expect(page.locator(".attempts li").first).to_contain_text("overlap")
    for tab in page.locator(".tabs button").all():
        box, bar = tab.bounding_box(), page.locator(".drawer").bounding_box()
        assert box and bar and box["x"] + box["width"] <= bar["x"] + bar["width"] - 36
    page.locator("#panel-attempts .inline").first.click()
    expect(page.locator("#panel-module h2")).to_contain_text(f"Module {place['modules'][0] + 1} ")
    # The whole chain is followed again once somebody asks for it.
    near = page.evaluate(INSIDE, place["modules"])["distance"]
    page.locator("#follow").click()
    page.locator("#follow").click()
    picture(page)
    assert page.evaluate(INSIDE, place["modules"])["distance"] > near
    expect(page.locator("#again")).to_contain_text("Try the default module size")


def test_time_limit_is_explained_on_a_phone(visit: Visit, hasty: Service) -> None:
    fold = hasty.fold(shape="wrench-94", preset="paper")["id"]
    state = hasty.wait_over(fold)
    assert state["error"]["code"] == "time-limit"
    frames = Timeline.open(hasty.directory(fold) / "timeline.zarr")
    assert frames.status == "failed" and len(frames) > 2
    page = with_view(visit(f"{hasty.http.base_url}/folds/{fold}", **PHONE))
    expect(page.locator("#stuck-heading")).to_have_text("Not finished")
    expect(page.locator("#stuck-more")).to_be_hidden()
    page.locator("#stuck-fold").click()
    expect(page.locator("#stuck-text")).to_contain_text("Exploding took longer than 8 s")
    expect(page.locator("#stuck-attempts")).to_have_text("The attempt")
    assert page.evaluate(WIDTH) <= 390
    found = looked_at(page, "failure-time-phone-where")
    assert found == state["summary"]["stuck"]["modules"] and len(found) > 10
    assert shown_frame(page) == len(frames) - 1
    page.keyboard.press("Home")
    at_frame(page, 0)


def test_memory_limit_is_explained(visit: Visit, tmp_path_factory: pytest.TempPathFactory) -> None:
    cells = layered_snake((8, 8, 8)).tolist()
    begun, ended = exploding_bytes(tmp_path_factory.mktemp("large") / "data", cells)
    assert ended - begun > 2**23
    limit = begun + 3 * (ended - begun) // 4
    small = Service(tmp_path_factory.mktemp("small") / "data", child_memory_bytes=limit).start()
    try:
        fold = small.fold(cells, strategy="simultaneous")["id"]
        state = small.wait_over(fold)
        assert (state["stage"], state["error"]["code"]) == ("explode", "memory-limit"), state
        frames = Timeline.open(small.directory(fold) / "timeline.zarr")
        assert frames.status == "failed" and len(frames) > 2
        page = with_view(visit(f"{small.http.base_url}/folds/{fold}", **LARGE))
        expect(page.locator("#stuck-heading")).to_have_text("Not finished")
        expect(page.locator("#stuck-text")).to_contain_text(f"more than {limit // 2**20} MiB")
        assert looked_at(page, "failure-memory") == state["summary"]["stuck"]["modules"]
        assert shown_frame(page) == len(frames) - 1
        page.keyboard.press("Home")
        at_frame(page, 0)
    finally:
        assert small.stop() == 0


def exploding_bytes(data: Path, cells: object) -> tuple[int, int]:
    """What the process of a fold has in memory as its explosion begins, and as it ends.

    The service is one of its own: its processes have computed nothing before.
    """
    service = Service(data).start()
    try:
        fold = service.fold(cells, strategy="simultaneous")["id"]
        seen: list[int] = []
        while not over(state := service.state(fold)):
            if state["stage"] == "explode":
                seen.append(max(process.memory_info().rss for process in service.children()))
            time.sleep(0.05)
        return seen[0], seen[-1]
    finally:
        assert service.stop() == 0


def test_knot_is_drawn_located_and_confirmed(
    visit: Visit, service: Service, tmp_path: Path
) -> None:
    corners = [(-TAIL, 0, 0), *OVERHAND[1:-1], (4, 6 + TAIL, 2)]
    # All at once it is shaken loose; module by module it is drawn tight.
    fold = service.fold(walk(tuple(corners)).tolist(), strategy="peel")["id"]
    state = service.wait_over(fold)
    assert (state["status"], state["summary"]["stuck"]["kind"]) == ("failed", "knot")
    for options, name in ((LAPTOP, "failure-knot"), (PHONE, "failure-knot-phone")):
        page = with_view(visit(f"/folds/{fold}", **options))
        expect(page.locator("#stuck-heading")).to_have_text("The chain is knotted")
        drawn = page.locator("#stuck-knot svg")
        assert drawn.get_attribute("aria-label") == "A knot with 3 crossings, determinant 3"
        assert drawn.locator("path").count() == 3
        found = looked_at(page, name)
        assert found == state["summary"]["stuck"]["modules"]
        # The knot is in the middle, between the tails.
        assert min(found) > TAIL and max(found) < len(walk(tuple(corners))) - TAIL
        assert shown_frame(page) == page.evaluate("() => window.foldback.timeline.last")
    page.locator("#stuck-fold").click()
    page.locator("#stuck-attempts").click()
    tried = page.locator(".attempts li")
    expect(tried).to_have_count(1)  # it is peeled one way only
    expect(tried).to_contain_text("the chain is knotted (determinant 3)")
    # Both files are there, and are enough to confirm the reason.
    expect(page.locator("#attempts code")).to_contain_text("_refusals.py plan.npz record.npz")
    for name in ("plan.npz", "record.npz"):
        link = page.locator(f"#attempts a[download='{name}']").get_attribute("href")
        (tmp_path / name).write_bytes(service.http.get(str(link)).content)
    found = foldback_check_refusals.check(tmp_path / "plan.npz", tmp_path / "record.npz")
    assert found["verdict"] == "refusal confirmed", found


def test_verified_fold_shows_no_failure(visit: Visit, wrench: str) -> None:
    page = visit(f"/folds/{wrench}", view=False)
    page.wait_for_function("() => window.foldback.timeline.complete")
    expect(page.locator("#stuck")).to_be_hidden()
    expect(page.locator("#jump option[value=stuck]")).to_have_attribute("hidden", "")
    assert page.evaluate(ORANGE) == []
    # What came out at once has nothing to tell of attempts.
    page.locator("#details").click()
    expect(page.locator("#tab-properties")).to_be_visible()
    expect(page.locator("#tab-attempts")).to_be_hidden()
