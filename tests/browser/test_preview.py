"""Previews and folds from a file or from an empty grid."""

import re
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page, Route, expect

from tests.browser.conftest import (
    NO_WEBGL,
    WIDTH,
    Visit,
    cancel_fold,
    choose,
    overflowing,
    picture,
    preview_file,
    resize,
    wait_for_fold,
    wait_for_preview,
    wait_until,
)
from tests.server.api.test_table import SLAB
from tests.server.files.test_preview import CORNER, stl, voxels
from tests.server.service_process import Service


def wait_for_rest(page: Page) -> None:
    """Wait until a preview and its 3D view are at rest."""
    wait_for_preview(page)
    page.locator("#cover.gone").wait_for(state="attached")
    page.locator('.stage[aria-busy="false"]').wait_for()


@pytest.fixture(scope="module")
def brick(service: Service) -> dict[str, Any]:
    """Preview of a brick, requested without its full result."""
    return service.preview("brick.stl", stl(), full="false")


def warmth(image: np.ndarray) -> np.ndarray:
    """Return red minus blue of each pixel: the last modules are yellow, the first ones blue."""
    return image[..., 0] - image[..., 2]


@pytest.mark.parametrize("view", [False, pytest.param(True, marks=pytest.mark.long)])
def test_mesh_is_previewed_changed_and_folded(visit: Visit, service: Service, view: bool) -> None:
    page = visit("/", width=760, height=420, view=view)
    preview_file(page, "brick.stl", stl())
    expect(page.locator("#name")).to_have_text("brick")
    expect(page.locator("#verdict")).to_have_text(re.compile(r"\d+ cubes · \d+\s% like your file"))
    page.locator(".more > summary").click()
    expect(page.locator("#preset")).to_be_visible()
    if view:
        wait_for_rest(page)
        seen_picture = picture(page)
        assert (warmth(seen_picture) > 40).mean() > 0.003
        assert (warmth(seen_picture) < -40).mean() > 0.003
        page.locator("[data-layer=path]").click()
        assert np.abs(picture(page) - seen_picture).max() > 40
        seen_picture = picture(page)
        page.locator(".surface").press("ArrowLeft")
        assert np.abs(picture(page) - seen_picture).max() > 40
    number = page.locator("#modules-number")
    number.fill("24")
    number.press("Enter")
    wait_for_preview(page)
    expect(page).to_have_url(re.compile(r"\?modules=24$"))
    modules = re.findall(r"\d+", page.locator("#fold").inner_text())[0]
    assert page.locator("#verdict").inner_text().startswith(f"{modules} cubes")
    page.locator("#fold").click()
    fold = wait_for_fold(page)
    expect(page.locator("#name")).to_have_text("brick")
    service.wait(fold, lambda state: state["modules"] == int(modules))  # counted after the start
    cancel_fold(page, service)


FIRST_SIGHT = ((390, 844), (360, 640), (640, 360), (1366, 768), (683, 384))
"""Sizes of a phone, a small phone upright and lying, a laptop, and the laptop at 200 %."""
LOSSES = "#iou, #reach button, #reach-limit:not([hidden]), #notes li:nth-child(-n + 2), #fold"
"""Selector of what a visitor should see before folding; further notes tell of cells."""
OUT_OF_SIGHT = """selector => [...document.querySelectorAll(selector)].filter((part) => {
  const { left, right, top, bottom } = part.getBoundingClientRect();
  const [x, y] = [(left + right) / 2, (top + bottom) / 2];
  const visible = (at) => part.contains(document.elementFromPoint(...at));
  const seen = [[x, top + 1], [left + 1, y], [right - 1, y], [x, bottom - 1]].every(visible);
  return !(seen && left >= 0 && right <= innerWidth && part.getClientRects().length);
}).map((part) => part.textContent)"""
"""Returns the texts of elements that are outside of the window, or behind something."""


@pytest.mark.long
def test_lossy_shape_says_so_at_first_sight(visit: Visit, service: Service) -> None:
    # A thin plate with a thin post.
    plate, post = ((0.0, 0.0, 0.0), (2.0, 2.0, 0.2)), ((0.0, 0.0, 0.0), (0.2, 0.2, 3.0))
    lossy = service.preview("parts.stl", stl(plate, post), modules="64")
    assert not lossy["keeps_parts"] and len(lossy["reach"]) == 3
    page = visit(lossy["links"]["page"] + "?modules=64", view=False)
    wait_for_preview(page)
    expect(page.locator("#notes li").first).to_contain_text(
        re.compile("use more modules", re.IGNORECASE)
    )
    for width, height in FIRST_SIGHT:
        resize(page, width, height)
        assert page.evaluate(OUT_OF_SIGHT, LOSSES) == []
    assert overflowing(page) == {}
    extra = page.locator("#reach button").last
    modules = int(re.sub(r"\D", "", extra.inner_text().partition(":")[2]))
    extra.click()
    wait_for_preview(page)
    expect(page).to_have_url(re.compile(rf"\?modules={modules}$"))
    snake = page.locator("[name=method][value=snake]")
    expect(snake).to_be_disabled()


@pytest.mark.long
def test_first_result_is_shown_until_the_final_one_is_there(visit: Visit, service: Service) -> None:
    page = visit("/", view=False)
    routes: list[Route] = []

    def hold(route: Route) -> None:
        if b'name="quick"' in (route.request.post_data_buffer or b""):
            route.continue_()
        else:
            routes.append(route)

    page.route("**/api/shapes/preview", hold)
    choose(page, "corner.stl", CORNER)
    expect(page.locator("#verdict")).to_have_text(re.compile("improving…$"))
    expect(page.locator("#fold")).to_have_text(re.compile(r"^Fold about \d+ cubes$"))
    expect(page.locator("#fold")).to_be_enabled()
    wait_until(page, lambda: bool(routes))
    first = page.locator("#drawing").get_attribute("src")
    routes.pop().continue_()
    wait_for_preview(page)
    expect(page.locator("#verdict")).to_have_text(re.compile("like your file$"))
    assert page.locator("#drawing").get_attribute("src") != first
    # If the final result does not come, the first one stays.
    page.locator("#modules-number").fill("40")
    page.locator("#modules-number").press("Enter")
    expect(page.locator("#verdict")).to_have_text(re.compile("improving…$"))
    wait_until(page, lambda: bool(routes))
    routes.pop().abort()
    wait_for_preview(page)
    expect(page.locator("#verdict")).to_have_text(re.compile("like your file$"))
    expect(page.locator("#fold")).to_be_enabled()


def test_preview_that_is_left_starts_no_3d_view(visit: Visit, brick: dict[str, Any]) -> None:
    page = visit("about:blank")
    drawings: list[Route] = []
    requests: list[Route] = []
    page.route("**/drawing.svg*", lambda route: drawings.append(route))
    page.route("**/api/folds", lambda route: requests.append(route))
    page.goto(brick["links"]["page"])
    page.locator("#fold").click()
    wait_until(page, lambda: bool(drawings and requests))
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
    page.go_back()
    wait_for_rest(page)
    page.go_forward()
    assert page.url.endswith("/about")


def test_preview_without_webgl_keeps_the_drawing(visit: Visit, brick: dict[str, Any]) -> None:
    page = visit(brick["links"]["page"], width=390, height=844, script=NO_WEBGL)
    expect(page.locator("#cover-text")).to_contain_text("WebGL is missing")
    expect(page.locator("#drawing")).to_be_visible()
    expect(page.locator("#fold")).to_be_enabled()
    assert page.locator("#view").get_attribute("src") is None


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
    # A scene is requested again after a response 503.
    busy = {"status": 503, "headers": {"Retry-After": "1"}}
    page.route("**/scene/*", lambda route: route.fulfill(**busy), times=1)
    page.locator("#modules-number").fill("64")
    page.locator("#modules-number").press("Enter")
    wait_for_rest(page)


def test_missing_path_is_explained_repaired_and_unrepaired(visit: Visit) -> None:
    page = visit("/", width=390, height=844, has_touch=True, view=False)
    preview_file(page, "slab.json", voxels(SLAB))
    expect(page.locator("#trouble")).to_be_visible()
    expect(page.locator("#fold")).to_be_disabled()
    page.locator("[name=world][value=table]").check(force=True)
    add = page.get_by_role("button", name=re.compile(r"^Add \d cells?: \d+ modules"))
    expect(add).to_be_visible()
    expect(page.locator("#problems")).to_contain_text("5 are black and 3 are white")
    assert page.evaluate(WIDTH) <= 390
    modules = re.findall(r"\d+", add.inner_text())[1]
    add.tap()
    expect(page.locator("#fold")).to_have_text(f"Fold {modules} cubes")
    expect(page.locator("#fold")).to_be_enabled()
    page.locator("#unrepair").tap()
    expect(page.locator("#trouble")).to_be_visible()


@pytest.mark.long
def test_chain_starts_in_the_clicked_module(
    visit: Visit, service: Service, brick: dict[str, Any]
) -> None:
    page = visit(brick["links"]["page"] + "?modules=64", width=1440, height=900)
    wait_for_rest(page)
    before = picture(page)
    view = page.locator("#view").bounding_box()
    page.mouse.click(view["x"] + 0.5 * view["width"], view["y"] + 0.5 * view["height"])
    expect(page.locator("#start-text")).to_contain_text(re.compile(r"Module \d+ of \d+"))
    module = int(re.findall(r"\d+", page.locator("#start-text").inner_text())[0])
    assert np.abs(picture(page) - before).max() > 40  # the module is highlighted
    page.locator("#start-button").click()
    wait_for_rest(page)
    cells = service.preview(preview=brick["id"], modules="64")["cells"]
    start = "%2C".join(map(str, cells[module - 1]))
    expect(page).to_have_url(re.compile(re.escape(f"start={start}")))
    page.locator("#start-button").click()
    wait_for_rest(page)
    expect(page.locator("#start")).to_be_hidden()
