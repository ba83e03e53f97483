"""Chains of tetrahedra, as a visitor meets them: typed, from a mesh, from the gallery."""

from __future__ import annotations

import re

import numpy as np
import pytest
from playwright.sync_api import expect

from tests.browser.conftest import Visit, picture, previewed
from tests.browser.test_preview import settled
from tests.server.files.test_preview import stl
from tests.server.service import Service

pytestmark = pytest.mark.long
RING = "- - - + - - - + - - -"


def test_typed_chain_folds_and_names_a_wrong_character(visit: Visit, service: Service) -> None:
    page = visit("/", width=1440, height=900)
    page.locator("#type").click()
    expect(page.locator("#angles")).to_be_focused()
    page.locator("#angles").fill("0 - x +")
    page.locator("#typed").click()
    expect(page.locator("#drop-message")).to_contain_text("Character 5")
    page.locator("#angles").fill(RING)
    page.keyboard.press("Enter")
    page.wait_for_url(re.compile("/folds/[a-z0-9]+$"))
    expect(page.locator("#verdict")).to_have_text(
        re.compile(
            r"^Verified \(simulated\): modules stay at least [\d.]+ % .* apart · 12 modules$"
        )
    )
    page.locator("#sketch.gone").wait_for(state="attached")
    page.keyboard.press("End")
    picture(page)
    page.locator("main.stage").click(position={"x": 720, "y": 380})
    expect(page.locator("#panel-module h2")).to_contain_text("Module")


def test_mesh_is_previewed_as_tetrahedra(visit: Visit) -> None:
    page = visit("/", width=1440, height=900)
    previewed(page, "brick.stl", stl())
    settled(page)
    cubes = picture(page)
    page.locator('[name="module"][value="tetrahedron"]').check()
    expect(page).to_have_url(re.compile(r"module=tetrahedron"))
    settled(page)
    expect(page.locator("#method-part")).to_be_hidden()
    expect(page.locator("#verdict")).to_have_text(
        re.compile(r"^\d+ tetrahedra · matches your model: \d+ %")
    )
    modules = int(re.findall(r"\d+", page.locator("#fold").inner_text())[0])
    assert modules % 12 == 0
    assert np.abs(picture(page) - cubes).max() > 40
    page.reload()
    settled(page)
    expect(page.locator('[name="module"][value="tetrahedron"]')).to_be_checked()
