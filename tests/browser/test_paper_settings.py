"""Settings of the published method, from the preview to the fold's page and beside another one."""

from __future__ import annotations

import json
import re
from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from planner.parameters.settings import SETTINGS
from tests.browser.conftest import called_off, keep
from tests.server.service import STAIRS, Service

pytestmark = [pytest.mark.browser, pytest.mark.slow]
Visit = Callable[..., Page]


@pytest.mark.long
def test_settings_are_offered_refused_at_their_field_and_shown(
    visit: Visit, service: Service
) -> None:
    found = service.http.post(
        "/api/shapes/preview", files={"file": ("stairs.json", json.dumps(STAIRS[:5]))}
    ).json()
    page = visit(found["links"]["page"], width=390, height=844, view=False)
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
        "Settings: got Damping = '2', expected a number from 0 to 0.9."
    )
    expect(damping).to_have_attribute("aria-invalid", "true")
    expect(damping).to_be_focused()
    keep(page, "preview-settings-390x844")
    damping.fill("0,12")
    page.locator("[name=step_s]").fill("0.01")  # as it is anyway: nothing is sent
    page.locator("#fold").click()
    page.wait_for_url(re.compile("/folds/[a-z0-9]+$"))
    expect(page.locator("#verdict")).to_have_text(re.compile("^Verified"))
    fold = page.url.rpartition("/")[2]
    assert service.state(fold)["settings"] == "damping=0.12,radial_gain=5"
    page.locator("#details").click()
    page.locator("#tab-properties").click()
    changed = page.locator(".group", has=page.get_by_role("heading", name="Changed settings"))
    expect(changed).to_contain_text("instead of 0.1")
    page.locator("#drawer-close").click()

    page.set_viewport_size({"width": 1440, "height": 900})
    page.locator("#compare").click()
    settings.locator("summary").click()
    gain.fill("none")
    published = page.locator("#compare-ways .way", has_text="Published method")
    published.click()
    expect(page.locator("#compare-message")).to_contain_text("got Radial force gain λ = 'none'")
    keep(page, "compare-settings-1440x900")
    gain.fill("20")
    published.click()
    page.wait_for_url(re.compile(rf"/compare\?a={fold}&b="))
    expect(page.locator(".side-preset").last).to_have_text(
        "Published parameters, Radial force gain λ 20"
    )
    called_off(page, service)
