"""Options of a fold as a visitor sets them: published parameters, a table, an objective."""

import json
import re

import numpy as np
import pytest
from playwright.sync_api import expect

from foldback.planner.parameters.settings_text import ROBOT_SETTINGS, SETTINGS
from foldback.planner.plan.plan import Plan
from tests.browser.conftest import (
    WIDTH,
    Visit,
    open_tab,
    picture,
    preview_file,
    wait_for_fold,
    wait_for_preview,
    wait_for_view,
)
from tests.server.api.test_table import voxels
from tests.server.service_process import STAIRS, Service


@pytest.mark.long
def test_paper_settings_are_offered_validated_and_shown(visit: Visit, service: Service) -> None:
    preview = service.preview("stairs.json", json.dumps(STAIRS[:5]))
    page = visit(preview["links"]["page"], width=390, height=844, view=False)
    wait_for_preview(page)
    settings = page.locator("#paper-settings")
    page.locator(".more > summary").click()
    page.locator("#preset").select_option("paper")
    settings.locator("summary").click()
    expect(settings.locator("input")).to_have_count(len(SETTINGS))
    damping, gain = (page.locator(f"[name={name}]") for name in ("damping", "radial_gain"))
    expect(damping).to_have_attribute("placeholder", "0.1")
    expect(page.locator(".setting", has=damping)).to_contain_text("published")
    gain.fill("5")
    damping.fill("2")
    page.locator("#fold").click()
    expect(page.locator("#problem")).to_have_text(
        "Settings: got Damping (damping) = '2', expected a number from 0 to 0.9."
    )
    expect(damping).to_be_focused()
    expect(damping).to_have_attribute("aria-invalid", "true")
    damping.fill("0,12")
    page.locator("[name=step_s]").fill("0.01")  # defaults are not sent
    page.locator("#fold").click()
    fold = wait_for_fold(page)
    expect(page.locator("#verdict")).to_have_text(re.compile("^Safe"))
    assert service.state(fold)["settings"] == "damping=0.12,radial_gain=5"
    open_tab(page, "properties")
    changed = page.locator(".group", has=page.locator("summary", has_text="Changed settings"))
    changed.locator("summary").click()
    expect(changed).to_contain_text("instead of 0.1")


@pytest.mark.long
def test_settings_of_robots_are_offered_and_validated(visit: Visit, service: Service) -> None:
    preview = service.preview("stairs.json", json.dumps(STAIRS[:6]))
    page = visit(preview["links"]["page"], width=390, height=844, view=False)
    wait_for_preview(page)
    settings = page.locator("#robot-settings")
    page.locator(".more > summary").click()
    settings.locator("summary").click()
    expect(settings.locator("input, select")).to_have_count(len(ROBOT_SETTINGS))
    masses = page.locator("[name=mass_error]")
    masses.fill("9")
    assert page.evaluate(WIDTH) <= 390
    settings.locator("summary").click()
    page.locator("#fold").click()
    expect(masses).to_be_focused()
    expect(page.locator("#problem")).to_contain_text("got Mass error (mass_error) = '9', expected")
    masses.fill("0.05")
    page.locator("#fold").click()
    assert service.state(wait_for_fold(page))["settings"] == "mass_error=0.05"


@pytest.mark.long
def test_fastest_plan_is_chosen_and_all_are_shown_as_dots_and_rows(
    visit: Visit, service: Service
) -> None:
    fold = service.fold(STAIRS, prefer="time")["id"]
    certificate = service.wait_over(fold)["summary"]["certificate"]
    attempts = Plan.load(service.directory(fold) / "plan.npz").attempts
    times = [attempt["figures"]["fold_time_s"] for attempt in attempts if "figures" in attempt]
    assert len(times) > 2 and certificate["fold_time_s"] == min(times)
    page = visit(f"/folds/{fold}", width=375, height=812, view=False)
    page.locator("#details").click()
    facts = service.http.get(f"/folds/{fold}/facts").json()
    plans = facts["choice"]["plans"]
    assert f"fastest of {len(plans)} plans" in facts["verdict"]["text"]
    (first,) = (way for way in facts["compare"] if way["text"] == "First plan that works")
    assert first["form"]["prefer"] == "computing"
    expect(page.locator(".choice-dot")).to_have_count(len(plans))
    expect(page.locator(".choice-dot.chosen")).to_have_count(1)
    expect(page.locator(".choice-table tbody tr")).to_have_count(len(plans))
    page.get_by_role("button", name="Clearance").click()
    expect(page.locator(".choice-axis")).to_have_text("Proved clearance, pitch")
    assert page.evaluate(WIDTH) <= 375
    page.locator(".choice-play a", has_text="Play").first.click()
    page.wait_for_url(re.compile(f"/folds/{fold}-[0-9]+"))
    expect(page.locator(".made")).to_contain_text("computed several plans")


TABLE = np.array([78, 84, 94])
"""Colour of the table in a dark view."""


@pytest.mark.long
def test_upload_folds_on_a_table(visit: Visit, service: Service) -> None:
    page = visit("/", width=1000, height=620)
    preview_file(page, "box.npy", voxels(2, 2, 2))
    page.locator("[name=world][value=table]").check(force=True)
    wait_for_preview(page)
    expect(page).to_have_url(re.compile("world=table"))
    page.locator("details.more summary").first.click()
    expect(page.locator("#preset")).to_be_disabled()
    page.locator("[name=table_torque]").fill("0")
    page.locator("#fold").click()
    expect(page.locator("#problem")).to_contain_text("(table_torque) = '0'")
    page.locator("[name=table_torque]").fill("9")
    expect(page.locator("[name=table_base]")).to_have_value("free")
    page.locator("[name=table_base]").select_option("clamped")
    page.locator("#fold").click()
    fold = wait_for_fold(page)
    expect(page.locator("#rests")).to_contain_text(
        re.compile(
            r"^The chain stays on .* at most [\d.]+ [nµm]?N·m \([\d.]+ w·p\) without friction$"
        )
    )

    page = wait_for_view(visit(f"/folds/{fold}#frame=100000", width=1000, height=620))
    seen_picture = picture(page)
    assert (np.abs(seen_picture - TABLE).max(axis=-1) < 14).mean() > 0.2
    page.locator("#colour-by").select_option("pressed")
    pressed = picture(page)
    expect(page.locator("#legend-high")).to_have_text(re.compile(r"^[\d.]+ × the module’s weight$"))
    assert np.abs(pressed - seen_picture).max() > 40

    page.locator("#rests").click()
    expect(page.locator("#on-table")).to_contain_text("the first module is clamped to the table")
    page.locator("#tab-plots").click()
    plot = page.locator(".plot").first
    expect(plot).to_contain_text("Largest torque on the table")
    expect(plot).to_contain_text("9 w·p limit")
