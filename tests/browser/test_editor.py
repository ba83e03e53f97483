"""The editor: painted, moved, opened from files, drawn as a path and folded, as visitors do."""

from __future__ import annotations

import io
import json
import re

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import WIDTH, Visit, cancel_fold, choose, opened_fold
from tests.server.files.test_preview import stl
from tests.server.service import SPIRAL, Service


def opened(page: Page, name: str, data: bytes) -> None:
    """Open a file and wait until it has been read."""
    choose(page, name, data)
    expect(page.locator("#reading")).to_contain_text(f"{name}: ")


@pytest.mark.long
def test_paint_undo_and_preview_by_keyboard(visit: Visit) -> None:
    page = visit("/shapes/new", width=1440, height=900, view=False)
    expect(page.locator("#empty")).to_be_visible()
    expect(page.locator("#model")).to_be_hidden()  # the words are not written over a drawing
    expect(page.locator("#preview")).to_be_disabled()
    page.locator('[data-x="5"][data-y="5"]').focus()
    page.keyboard.press("Space")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Space")
    expect(page.locator("#count")).to_have_text("16 modules")
    page.keyboard.press("Control+z")
    expect(page.locator("#count")).to_have_text("8 modules")
    page.keyboard.press("Control+Shift+z")
    page.keyboard.press("PageUp")
    expect(page.locator("#layer")).to_have_text("Layer 2")
    expect(page.locator(".grid .below")).to_have_count(2)
    page.locator("#repeat").click()
    expect(page.locator("#count")).to_have_text("32 modules")
    page.locator('[data-x="0"][data-y="0"]').click()
    expect(page.locator("#count")).to_have_attribute("data-tone", "bad")  # two pieces
    expect(page.locator("#fold")).to_be_disabled()
    page.locator("#undo").click()
    page.reload()
    expect(page.locator("#count")).to_have_text("32 modules")  # nothing painted is lost
    page.locator("#preview").click()
    page.wait_for_url(re.compile("/previews/"))
    expect(page.locator("#verdict")).to_have_text("32 modules")


def test_letter_is_cut_by_dragging_and_folded(visit: Visit, service: Service) -> None:
    page = visit("/shapes/new", width=390, height=844, view=False)
    page.get_by_label("Letter L").click()
    expect(page.locator("#count")).to_have_text("72 modules")
    first = page.locator('[data-x="2"][data-y="2"]').bounding_box()
    last = page.locator('[data-x="4"][data-y="2"]').bounding_box()
    page.mouse.move(first["x"] + 9, first["y"] + 9)
    page.mouse.down()
    page.mouse.move(last["x"] + 9, last["y"] + 9, steps=8)
    page.mouse.up()
    expect(page.locator("#count")).to_have_text("48 modules")  # a stroke from a filled cell empties
    page.locator("#fold").click()
    opened_fold(page)
    expect(page.locator("#name")).to_have_text("Letter L")
    cancel_fold(page, service)


@pytest.mark.long
def test_tools_files_and_a_drawn_path(visit: Visit, service: Service) -> None:
    page = visit("/shapes/new", width=1366, height=768, view=False)
    count, grid = page.locator("#count"), page.locator("#grid")

    def at(x: int, y: int) -> tuple[float, float]:
        box = page.locator(f'[data-x="{x}"][data-y="{y}"]').bounding_box()
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    # A pointer that is fast leaves nothing out; what is painted on both sides is painted twice.
    page.locator('[data-both="1"]').click()
    page.mouse.move(*at(2, 1))
    page.mouse.down()
    page.mouse.move(*at(7, 1))
    page.mouse.up()
    expect(page.locator(".grid .on")).to_have_count(12)
    page.locator('[data-both="1"]').click()
    page.locator("#undo").click()
    expect(page.locator(".grid .on")).to_have_count(0)

    # A voxel file in a grid that is large enough, moved and in a mirror, each undone.
    voxels = np.zeros((13, 2, 1), bool)
    voxels[:, 0] = voxels[0] = True
    data = io.BytesIO()
    np.save(data, voxels)
    opened(page, "hook.npy", data.getvalue())
    expect(page.locator("#size")).to_have_value("16")
    expect(page.locator("#name")).to_have_value("hook")
    expect(count).to_have_text("112 modules")
    head = page.locator('[data-x="1"][data-y="8"]')
    expect(head).to_have_class(re.compile("on"))
    grid.locator('[tabindex="0"]').focus()
    page.keyboard.press("m")
    page.keyboard.press("ArrowRight")
    expect(page.locator('[data-x="1"][data-y="9"]')).to_have_class(re.compile("on"))
    page.locator('[data-mirror="0"]').click()
    expect(page.locator('[data-x="13"][data-y="9"]')).to_have_class(re.compile("on"))
    for _ in range(3):
        page.keyboard.press("Control+z")
    expect(page.locator("#size")).to_have_value("10")
    expect(page.locator("#empty")).to_be_visible()

    # What cannot be used is told in the service's words; a mesh is made anew of as many cells.
    opened(page, "cube.npy", data.getvalue()[:-3])
    expect(page.locator("#reading")).to_contain_text("fewer than")
    opened(page, "brick.stl", stl())
    mesh = int(re.findall(r"[\d\u2009]+(?= cells)", page.locator("#reading").inner_text())[0])
    assert 120 < mesh < 200
    page.locator("#mesh-cells").fill("16")
    page.locator("#mesh-cells").press("Enter")
    expect(page.locator("#reading")).to_have_text("brick.stl: 16 cells.")
    expect(count).to_have_text("128 modules")
    with page.expect_download() as download:
        page.locator("#save-cells").click()
    assert download.value.suggested_filename == "brick.voxels.json"
    saved = json.loads(download.value.path().read_text())
    assert saved["format"] == "foldback-voxels/1"
    assert len(saved["cells"]) == 16
    page.locator("#clear").click()
    page.locator("#name").fill("spiral")

    # A path is drawn with the keyboard and checked as it grows.
    page.locator('[data-x="5"][data-y="5"]').focus()
    page.keyboard.press("d")
    expect(page.locator('[name="exact"][value="path"]')).to_be_checked()
    keys = {(1, 0, 0): "ArrowDown", (-1, 0, 0): "ArrowUp", (0, 1, 0): "ArrowRight"}
    keys |= {(0, -1, 0): "ArrowLeft", (0, 0, 1): "PageUp", (0, 0, -1): "PageDown"}
    own = [*SPIRAL, [-1, 2, 1], [-1, 1, 1]]
    steps = np.diff(np.array(own), axis=0)
    page.keyboard.press("Shift+ArrowDown")  # begins where the cursor is
    for step in steps.tolist():
        page.keyboard.press(f"Shift+{keys[tuple(step)]}")
    expect(count).to_have_text(f"The path visits all {len(own)} cells.")
    expect(page.locator("#layer")).to_have_text("Layer 2")
    expect(page.locator("#checked")).to_contain_text("Folds in about")
    page.keyboard.press("Backspace")
    expect(count).to_contain_text(f"{len(own) - 1} of {len(own)} cells")
    expect(page.locator("#fold")).to_be_disabled()
    page.locator("#complete").click()
    expect(count).to_have_text(f"The path visits all {len(own)} cells.")

    # Taken away and opened again it is the same path; it is the one that is folded.
    with page.expect_download() as download:
        page.locator("#save-path").click()
    written = download.value.path().read_bytes()
    page.locator("#unpath").click()
    expect(count).to_contain_text("No path yet")
    opened(page, "own.json", written)
    expect(page.locator("#reading")).to_have_text(f"own.json: {len(own)} cells along their path.")
    page.locator("#fold").click()
    fold = opened_fold(page)
    sent = json.loads((service.directory(fold) / "input").read_bytes())
    assert sent["format"] == "foldback-path/1"
    assert np.diff(np.array(sent["cells"]), axis=0).tolist() == steps.tolist()
    expect(page.locator("#name")).to_have_text("spiral")
    service.wait_over(fold)
    assert service.state(fold)["modules"] == len(own)


@pytest.mark.long
def test_path_by_touch_is_completed_and_cut(visit: Visit) -> None:
    page = visit("/shapes/new", width=390, height=844, view=False, has_touch=True)
    page.get_by_label("Letter E").click()
    page.locator('[data-tool="path"]').click()
    count = page.locator("#count")
    page.locator('[data-x="2"][data-y="2"]').tap()
    expect(count).to_contain_text("1 of 16 cells")
    page.locator('[data-x="8"][data-y="8"]').tap()
    expect(page.locator("#message")).not_to_be_empty()  # it touches no end
    page.locator('[data-x="2"][data-y="3"]').tap()
    expect(page.locator("#message")).to_have_text("")
    page.locator('[data-x="2"][data-y="2"]').tap()  # back again
    expect(count).to_contain_text("1 of 16 cells")
    assert page.evaluate(WIDTH) <= 390
    assert page.evaluate("getComputedStyle(document.getElementById('grid')).touchAction") == (
        "pinch-zoom"
    )
    page.locator("#complete").click()
    expect(page.locator("#message")).not_to_be_empty()  # it cannot be completed
    page.get_by_label("Letter O").click()  # a ring: from any cell there is a way around
    page.locator('[data-x="2"][data-y="2"]').tap()
    page.locator("#complete").click()
    expect(count).to_have_text("The path visits all 16 cells.")
    page.locator('[data-x="6"][data-y="6"]').tap()
    page.locator("#cut").click()
    expect(count).to_contain_text("of 16 cells")
