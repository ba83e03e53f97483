"""A fold on a table, as a visitor asks for it and looks at it."""

from __future__ import annotations

import re
from typing import cast

import numpy as np
import pytest
import trimesh
from playwright.sync_api import Page, expect

from tests.browser.conftest import Visit, answered, opened_fold, picture, previewed, with_view
from tests.browser.test_preview import settled
from tests.server.api.test_table import SLAB, voxels
from tests.server.files.test_preview import voxels as cells_as_file
from tests.server.service import Service

TABLE = np.array([78, 84, 94])
"""Its colour in a dark view."""


def colour_by(page: Page, name: str) -> np.ndarray:
    page.locator("#colour-by").select_option(name)
    return picture(page)


@pytest.mark.long
def test_upload_folds_on_a_table(visit: Visit, service: Service) -> None:
    page = visit("/", width=1000, height=620)
    previewed(page, "box.npy", voxels(2, 2, 2))
    page.locator("[name=world][value=table]").check(force=True)
    answered(page)
    expect(page).to_have_url(re.compile("world=table"))
    expect(page.locator("#world-hint")).to_contain_text("table")
    expect(page.locator("#what")).to_be_hidden()
    expect(page.locator("#prefer-part")).to_be_hidden()
    page.locator("details.more summary").first.click()
    expect(page.locator("#preset")).to_be_disabled()
    page.locator("[name=table_torque]").fill("0")
    page.locator("#fold").click()
    expect(page.locator("#problem")).to_contain_text("table_torque = '0'")
    page.locator("[name=table_torque]").fill("9")
    assert page.locator("[name=table_base] option").all_inner_texts() == ["clamped", "free"]
    expect(page.locator("[name=table_base]")).to_have_value("free")
    page.locator("[name=table_base]").select_option("clamped")
    page.locator("#fold").click()
    fold = opened_fold(page)
    expect(page.locator("#rests")).to_contain_text(
        re.compile(r"^Stays on .* at most [\d.]+ w·p \([\d.]+ [nµm]?N·m\), frictionless$")
    )

    page = with_view(visit(f"/folds/{fold}#frame=100000", width=1000, height=620))
    seen = picture(page)
    assert (np.abs(seen - TABLE).max(axis=-1) < 14).mean() > 0.2
    torques = colour_by(page, "joint_torque")
    expect(page.locator("#legend-high")).to_have_text(re.compile(r"^[\d.]+ w·p, [\d.]+ [nµm]?N·m$"))
    assert np.abs(torques - seen).max() > 40
    pressed = colour_by(page, "pressed")
    expect(page.locator("#legend-high")).to_have_text(re.compile(r"^[\d.]+ × its weight$"))
    assert np.abs(pressed - torques).max() > 40

    page.locator("#rests").click()
    expect(page.locator("#on-table .assumptions li").first).to_be_visible()
    expect(page.locator("#on-table")).to_contain_text("No friction: the table exerts no forces")
    expect(page.locator("#on-table")).to_contain_text("the first module is clamped to the table")
    expect(page.locator("#on-table .servos a").first).to_have_attribute(
        "href", re.compile("^https://")
    )
    page.locator("#tab-plots").click()
    plot = page.locator(".plot").first
    expect(plot).to_contain_text("Largest torque on the table")
    expect(plot).to_contain_text("frictionless")
    expect(plot).to_contain_text("9 w·p limit")
    assert plot.locator(".plot-bound").count() == 2

    page.locator("#compare").click()
    expect(page.locator("#compare-ways")).to_contain_text("In zero gravity")


def test_slab_without_a_path_is_repaired_on_a_click(visit: Visit) -> None:
    page = visit("/", view=False)
    previewed(page, "slab.json", cells_as_file(SLAB))
    page.locator("[name=world][value=table]").check(force=True)
    add = page.get_by_role("button", name=re.compile(r"^Add \d cells?: \d+ modules"))
    expect(add).to_be_visible()
    modules = re.findall(r"\d+", add.inner_text())[1]
    expect(page.locator("#problems")).to_contain_text("5 black and 3 white cells")
    add.click()
    expect(page.locator("#fold")).to_have_text(f"Fold {modules} modules")
    expect(page.locator("#fold")).to_be_enabled()


@pytest.mark.long
def test_offers_of_a_mesh_without_a_path_on_a_table(visit: Visit) -> None:
    page = visit("/", width=1366, height=768)
    torus = trimesh.creation.torus(major_radius=10, minor_radius=4).export(file_type="stl")
    previewed(page, "torus.stl", cast("bytes", torus))
    page.goto(page.url.partition("?")[0] + "?modules=160&world=table")
    settled(page)
    expect(page.locator("#odd-text")).to_contain_text("too many of")
    expect(page.locator("#nearest button")).to_have_count(0)
    expect(page.locator("#problems")).to_contain_text("84 black and 76 white cells")
    expect(page.locator("#long")).to_contain_text("more than 96 modules")
    expect(page.locator("#repairs .button.primary")).to_be_visible(timeout=60_000)
    page.locator("#repairs .button.primary").click()
    expect(page.locator("#fold")).to_be_enabled(timeout=30_000)
    expect(page).to_have_url(re.compile("method=blocks"))
    page.reload()
    expect(page.locator("#fold")).to_have_text("Fold 96 modules", timeout=30_000)
    expect(page.locator("#long")).to_be_empty()
    expect(page.locator("#repaired")).to_contain_text("2×2×2")
