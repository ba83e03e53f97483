"""From a file, or from nothing, to a preview and a fold, as a visitor meets it."""

from __future__ import annotations

import json
import re
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page, Route, expect

from tests.browser.conftest import (
    NO_WEBGL,
    WIDTH,
    Visit,
    answered,
    cancel_fold,
    opened_fold,
    picture,
    previewed,
    until,
)
from tests.server.files.test_preview import CROSS, box, stl, voxels
from tests.server.service import Service


def settled(page: Page) -> None:
    """Waits until the view is as well."""
    answered(page)
    page.locator("#cover.gone").wait_for(state="attached")
    page.locator('.stage[aria-busy="false"]').wait_for()


@pytest.fixture(scope="module")
def brick(service: Service) -> dict[str, Any]:
    """A preview that was asked for."""
    return service.http.post(
        "/api/shapes/preview", files={"file": ("brick.stl", stl())}, data={"full": "false"}
    ).json()


def warm(image: np.ndarray) -> np.ndarray:
    """How much more red than blue each pixel is: the last modules are yellow, the first blue."""
    return image[..., 0] - image[..., 2]


NOTE_WEBGL = """window.asked = [];
const getContext = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
  const drawing = document.getElementById("drawing");
  if (kind.startsWith("webgl")) asked.push([
    document.getElementById("verdict").textContent,
    drawing.complete && drawing.naturalWidth > 0 && !drawing.hidden]);
  return getContext.call(this, kind, ...more);
};"""
"""Notes what the page showed whenever it asked for WebGL."""


@pytest.mark.parametrize("view", [False, pytest.param(True, marks=pytest.mark.long)])
def test_mesh_is_previewed_changed_and_folded(visit: Visit, service: Service, view: bool) -> None:
    page = visit("/", width=760, height=420, view=view)
    expect(page.locator(".drop-title")).to_have_text(
        "Drop an STL mesh, a voxel model, a path or a chain"
    )
    previewed(page, "brick.stl", stl())
    expect(page.locator("#name")).to_have_text("brick")
    expect(page.locator("#verdict")).to_have_text(
        re.compile(r"\d+ modules · matches your model: \d+ %")
    )
    expect(page.locator("#knot")).to_have_text("None")
    expect(page.locator("#preset")).to_be_hidden()
    page.locator(".more > summary").click()
    expect(page.locator("#preset")).to_be_visible()
    if view:
        settled(page)
        seen = picture(page)
        assert (warm(seen) > 40).mean() > 0.003
        assert (warm(seen) < -40).mean() > 0.003
        page.locator("[data-layer=path]").click()
        expect(page.locator("[data-layer=path]")).to_have_attribute("aria-pressed", "false")
        solid = picture(page)
        assert np.abs(solid - seen).max() > 40
        page.locator("[data-layer=path]").click()

    number = page.locator("#modules-number")
    number.fill("24")
    number.press("Enter")
    answered(page)
    expect(page).to_have_url(re.compile(r"\?modules=24$"))
    words = page.locator("#fold").inner_text()
    modules = re.findall(r"\d+", words)[0]
    assert page.locator("#verdict").inner_text().startswith(f"{modules} modules")
    if page.locator("#nearest button").count():
        other = page.locator("#nearest button").first
        count = other.inner_text()
        other.click()
        answered(page)
        expect(page.locator("#fold")).to_have_text(f"Fold {count} modules")
        number.fill("24")
        number.press("Enter")
        answered(page)
    page.locator("#fold").click()
    fold = opened_fold(page)
    expect(page.locator("#name")).to_have_text("brick")
    assert service.state(fold)["modules"] == int(modules)
    cancel_fold(page, service)


def test_drawing_comes_before_the_3d_view(visit: Visit, brick: dict[str, Any]) -> None:
    page = visit("about:blank", script=NOTE_WEBGL)
    page.route("**/view", lambda route: None)  # the 3D view never comes
    page.goto(brick["links"]["page"])
    expect(page.locator("#drawing")).to_be_visible()
    expect(page.locator("#cover-text")).to_have_text("Starting the 3D view…")
    expect(page.locator("#view")).to_have_attribute("src", "/view")
    [(verdict, drawn)] = page.evaluate("window.asked")
    assert "modules" in verdict
    assert drawn
    before = page.locator("#drawing").get_attribute("src")
    page.locator("#modules-number").fill("64")
    page.locator("#modules-number").press("Enter")
    expect(page.locator("#drawing")).not_to_have_attribute("src", before or "")


def test_preview_that_is_left_starts_no_3d_view(visit: Visit, brick: dict[str, Any]) -> None:
    page = visit("about:blank")
    drawings: list[Route] = []
    requests: list[Route] = []
    page.route("**/drawing.svg*", lambda route: drawings.append(route))
    page.route("**/api/folds", lambda route: requests.append(route))
    page.goto(brick["links"]["page"])
    page.locator("#fold").click()
    until(page, lambda: bool(drawings and requests))
    drawings[0].continue_()
    expect(page.locator("#drawing")).to_be_visible()
    page.wait_for_timeout(600)
    assert page.locator("#view").get_attribute("src") is None
    requests[0].fulfill(status=503)
    page.unroute("**/drawing.svg*")
    expect(page.locator("#view")).to_have_attribute("src", "/view")


def test_forward_leads_on_from_a_preview_that_was_returned_to(
    visit: Visit, brick: dict[str, Any]
) -> None:
    page = visit(brick["links"]["page"])
    page.goto("/about")
    for _ in range(2):
        page.go_back()
        settled(page)
        page.go_forward()
        assert page.url.endswith("/about")


def test_preview_without_webgl_keeps_the_drawing(visit: Visit, brick: dict[str, Any]) -> None:
    page = visit(brick["links"]["page"], width=390, height=844, script=NO_WEBGL)
    expect(page.locator("#cover-text")).to_contain_text("WebGL is missing")
    expect(page.locator("#drawing")).to_be_visible()
    expect(page.locator("#fold")).to_be_enabled()
    assert page.locator("#view").get_attribute("src") is None


@pytest.mark.long
def test_largest_number_of_modules_is_stated(visit: Visit, brick: dict[str, Any]) -> None:
    page = visit(brick["links"]["page"] + "?modules=15000", script=NO_WEBGL)
    expect(page.locator("#got")).to_contain_text("At most 12\u2009000 modules")
    expect(page.locator("#modules-number")).to_have_value("12000")
    expect(page).to_have_url(re.compile("modules=12000"))


@pytest.mark.long
def test_preview_recovers_when_its_scene_fails_or_is_busy(
    visit: Visit, brick: dict[str, Any]
) -> None:
    page = visit("about:blank", width=760, height=420)
    page.route("**/scene/*", lambda route: route.fulfill(status=404))
    page.goto(brick["links"]["page"])
    expect(page.locator("#cover-text")).to_contain_text("could not be loaded")
    expect(page.locator("#drawing")).to_be_visible()
    expect(page.locator("#fold")).to_be_enabled()
    expect(page.locator(".stage")).to_have_attribute("aria-busy", "false")
    page.unroute("**/scene/*")
    # What is busy is asked again.
    busy = {"status": 503, "headers": {"Retry-After": "1"}}
    page.route("**/scene/*", lambda route: route.fulfill(**busy), times=1)
    page.locator("#modules-number").fill("64")
    page.locator("#modules-number").press("Enter")
    settled(page)
    # The slider asks again for each step, and the view follows.
    before = page.locator("#fold").inner_text()
    page.locator("#modules").focus()
    for _ in range(8):
        page.keyboard.press("PageUp")
    expect(page.locator("#fold")).not_to_have_text(before)
    settled(page)
    asked = int(page.locator("#modules-number").input_value())
    got = int(re.findall(r"\d+", page.locator("#fold").inner_text().replace("\u2009", ""))[0])
    assert abs(got - asked) <= 0.3 * asked


def test_missing_path_is_explained_repaired_and_unrepaired(visit: Visit) -> None:
    page = visit("/", width=390, height=844, has_touch=True, view=False)
    previewed(page, "cross.json", voxels(CROSS, name="Cross"))
    expect(page.locator("#trouble")).to_be_visible()
    expect(page.locator("#problems li").first).not_to_be_empty()
    expect(page.locator("#fold")).to_be_disabled()
    assert page.evaluate(WIDTH) <= 390
    page.locator("#repairs .button.primary").tap()
    expect(page.locator("#repaired")).to_be_visible()
    expect(page.locator("#fold")).to_be_enabled()
    page.locator("#unrepair").tap()
    expect(page.locator("#trouble")).to_be_visible()


@pytest.mark.long
def test_separate_cells_are_offered_only_repairs_that_help(visit: Visit) -> None:
    page = visit("/", width=1440, height=900, view=False)
    previewed(page, "apart.json", voxels([[0, 0, 0], [1, 0, 0], [2, 0, 0], [9, 0, 0]]))
    expect(page.locator("#problems li").first).to_contain_text("2 parts")
    expect(page.locator("#repairs .button")).to_have_count(1)
    expect(page.locator("#repairs")).not_to_contain_text("Use blocks")
    page.locator("[name=method][value=blocks]").check()
    expect(page.locator("#notes li").first).to_have_text("Each voxel became 2×2×2 modules.")


@pytest.mark.long
def test_cells_in_no_order_are_shown_as_voxels(visit: Visit, service: Service) -> None:
    page = visit("/", width=960, height=640, view=False)
    previewed(page, "cells.json", json.dumps(box(4, 3, 2)[::-2] + box(4, 3, 2)[::2]).encode())
    expect(page.locator("#verdict")).to_have_text("24 modules")
    expect(page.locator("#unordered")).to_have_text(
        "Read as voxels, because cells 2 and 3 are not neighbours."
    )
    expect(page.locator("#unordered")).to_be_in_viewport()
    page.locator("#fold").click()
    opened_fold(page)
    cancel_fold(page, service)


@pytest.mark.long
@pytest.mark.parametrize(("width", "height"), [(1440, 900), (390, 844)])
def test_chain_starts_in_the_clicked_module(
    visit: Visit, service: Service, brick: dict[str, Any], width: int, height: int
) -> None:
    page = visit(brick["links"]["page"] + "?modules=64", width=width, height=height)
    settled(page)
    expect(page.locator("#start")).to_be_hidden()
    before = picture(page)
    view = page.locator("#view").bounding_box()
    page.mouse.click(view["x"] + 0.5 * view["width"], view["y"] + 0.5 * view["height"])
    expect(page.locator("#start-text")).to_contain_text(re.compile(r"Module \d+ of \d+"))
    module = int(re.findall(r"\d+", page.locator("#start-text").inner_text())[0])
    assert np.abs(picture(page) - before).max() > 40  # the module stands out
    page.locator("#start-button").click()
    settled(page)
    expect(page).to_have_url(re.compile("start="))
    expect(page.locator("#start-text")).to_contain_text("Starts in (")
    cells = service.http.post(
        "/api/shapes/preview", data={"preview": brick["id"], "modules": "64"}
    ).json()["cells"]
    start = re.findall(r"start=([-\d%2C,]+)", page.url)[0].replace("%2C", ",")
    assert start == ",".join(map(str, cells[module - 1]))
    page.locator("#start-button").click()
    settled(page)
    expect(page.locator("#start")).to_be_hidden()
