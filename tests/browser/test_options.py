"""Settings of the published method, and the plans that a wish had to choose from."""

from __future__ import annotations

import json
import re

import pytest
from playwright.sync_api import expect

from planner.parameters.settings import SETTINGS
from tests.browser.conftest import Visit, answered, cancel_fold
from tests.server.service import STAIRS, Service


@pytest.mark.long
def test_paper_settings_are_offered_validated_and_shown(visit: Visit, service: Service) -> None:
    found = service.http.post(
        "/api/shapes/preview", files={"file": ("stairs.json", json.dumps(STAIRS[:5]))}
    ).json()
    page = visit(found["links"]["page"], width=390, height=844, view=False)
    answered(page)
    settings = page.locator("#paper-settings")
    page.locator(".more > summary").click()
    expect(settings).to_be_hidden()
    usual = page.locator("#expected").inner_text()
    page.locator("#preset").select_option("paper")
    expect(page.locator("#expected")).not_to_have_text(usual)
    settings.locator("summary").click()
    expect(settings.locator("input")).to_have_count(len(SETTINGS))
    damping, gain = (page.locator(f"[name={name}]") for name in ("damping", "radial_gain"))
    expect(damping).to_have_attribute("placeholder", "0.1")
    expect(page.locator(".setting", has=damping)).to_contain_text("published")
    gain.fill("5")
    damping.fill("2")
    page.locator("#fold").click()
    expect(page.locator("#problem")).to_have_text(
        "Settings: Expected a number from 0 to 0.9, but found Damping = '2'."
    )
    expect(damping).to_have_attribute("aria-invalid", "true")
    expect(damping).to_be_focused()
    damping.fill("0,12")
    page.locator("[name=step_s]").fill("0.01")  # as it is anyway: nothing is sent
    page.locator("#fold").click()
    page.wait_for_url(re.compile("/folds/[a-z0-9]+$"))
    expect(page.locator("#verdict")).to_have_text(re.compile("^Verified"))
    fold = page.url.rpartition("/")[2]
    assert service.state(fold)["settings"] == "damping=0.12,radial_gain=5"
    page.locator("#details").click()
    page.locator("#tab-properties").click()
    changed = page.locator(".group", has=page.locator("summary", has_text="Changed settings"))
    changed.locator("summary").click()
    expect(changed).to_contain_text("instead of 0.1")
    page.locator("#drawer-close").click()

    page.set_viewport_size({"width": 1440, "height": 900})
    page.locator("#compare").click()
    settings.locator("summary").click()
    gain.fill("none")
    published = page.locator("#compare-ways .way", has_text="Published method")
    published.click()
    expect(page.locator("#compare-message")).to_contain_text("found Radial force gain λ = 'none'")
    gain.fill("20")
    published.click()
    page.wait_for_url(re.compile(rf"/compare\?a={fold}&b="))
    expect(page.locator(".side-preset").last).to_have_text(
        "Published parameters, Radial force gain λ 20"
    )
    cancel_fold(page, service)


FITS = """() => document.documentElement.scrollWidth <= innerWidth
  && document.querySelector(".choice-plot svg").getBoundingClientRect().right <= innerWidth"""


@pytest.mark.long
def test_choice_lists_all_plans_as_dots_and_rows(visit: Visit, service: Service) -> None:
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
    expect(page.locator(".choice-play button")).to_have_count(1)
    page.get_by_role("button", name="Clearance").click()
    expect(axis).to_have_text("Clearance, pitch")
    assert page.evaluate(FITS)
    other = page.locator(".choice-play a", has_text="Play").first
    other.click()
    page.wait_for_url(re.compile(f"/folds/{fold}-[0-9]+"))
    expect(page.locator(".made")).to_contain_text("This plan was not chosen.")
    page.wait_for_function("() => window.foldback.timeline.complete")
