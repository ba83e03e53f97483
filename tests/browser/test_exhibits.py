"""Folds that are shown to others: in a kiosk, and to a class that follows its leader."""

from __future__ import annotations

import re

from playwright.sync_api import FrameLocator, Page, expect

from bench.service.kiosk import faster
from tests.browser.conftest import Visit
from tests.server.service import Service

TARGET_PX = 64
SPEED = 6


def _shown(page: Page) -> FrameLocator:
    return page.frame_locator("iframe:not(.coming)")


def test_kiosk_plays_on_without_network_and_returns_from_a_visitor(
    visit: Visit, service: Service, wrench: str
) -> None:
    other = service.fold(shape="wrench-24", seed="6")["id"]
    service.wait_over(other)
    for folds, status in (("nothing", 404), ("a/b", 422), (",".join(["a"] * 51), 422)):
        assert service.http.get("/kiosk", params={"folds": folds}).status_code == status
    page = visit(f"/kiosk?kiosk=10&folds={wrench},{other}", view=False, script=faster(SPEED))
    shown = _shown(page)
    expect(shown.locator(".tour-caption")).to_contain_text("The chain is straight")
    first = page.locator("iframe:not(.coming)").get_attribute("src")
    assert first == f"/embed/{wrench}?kiosk=10"
    assert shown.locator("a:visible").count() == 0
    assert page.locator("a:visible").count() == 0
    for one in [*shown.locator("button:visible, input:visible").all(), page.locator("#next")]:
        box = one.bounding_box()
        assert box and min(box["width"], box["height"]) >= TARGET_PX

    page.context.set_offline(True)
    page.locator("#next").click()
    expect(page.locator("iframe")).to_have_count(1)  # the next one has failed
    expect(page.locator("#trouble")).to_be_hidden()
    expect(shown.locator(".tour-count")).to_have_text(re.compile("^[2-9] of"))  # plays on
    page.context.set_offline(False)
    expect(page.locator(f"iframe[src^='/embed/{other}']:not(.coming)")).to_be_visible()

    expect(shown.locator(".tour .primary")).to_have_text("Pause")
    shown.locator("#sketch").click()
    expect(shown.locator(".tour .primary")).to_have_text("Play tour")
    expect(page.locator(f"iframe[src^='/embed/{wrench}']:not(.coming)")).to_be_visible()
