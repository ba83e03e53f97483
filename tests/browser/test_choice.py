"""The plans that a wish had to choose from: dots and a table, on a phone too, in either axis."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import keep
from tests.server.service import STAIRS, Service

pytestmark = [pytest.mark.browser, pytest.mark.slow]
FITS = """() => document.documentElement.scrollWidth <= innerWidth
  && document.querySelector(".choice-plot svg").getBoundingClientRect().right <= innerWidth"""


@pytest.mark.long
def test_all_plans_are_dots_and_rows(visit: Callable[..., Page], service: Service) -> None:
    fold = service.fold(STAIRS, prefer="time")["id"]
    service.wait_over(fold)
    page = visit(f"/folds/{fold}", width=375, height=812, view=False)
    page.locator("#details").click()
    plans = service.http.get(f"/folds/{fold}/facts").json()["choice"]["plans"]
    expect(page.locator(".choice-dot")).to_have_count(len(plans))
    expect(page.locator(".choice-dot.chosen")).to_have_count(1)
    expect(page.locator(".choice-table tbody tr")).to_have_count(len(plans))
    axis = page.locator(".choice-axis")
    expect(axis).to_contain_text("Torque at a folding time of")
    expect(page.get_by_role("button", name="Play this plan")).to_have_count(1)
    expect(page.locator("#choice")).to_contain_text("Only the chosen plan is stored")
    page.get_by_role("button", name="Clearance").click()
    expect(axis).to_have_text("Clearance, pitch")
    assert page.evaluate(FITS)
    keep(page, "choice")
