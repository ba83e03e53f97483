"""Editor: painting, moving, opening files, drawing a path, and folding, as visitors do."""

import io
import json
import re

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import (
    WIDTH,
    Visit,
    cancel_fold,
    choose,
    drag,
    overflowing,
    wait_for_fold,
)
from tests.server.files.test_preview import stl
from tests.server.service_process import SPIRAL, Service


def open_file(page: Page, name: str, data: bytes) -> None:
    """Open a file and wait until it has been read."""
    choose(page, name, data)
    expect(page.locator("#reading")).to_contain_text(f"{name}: ")


@pytest.mark.long
def test_paint_undo_and_preview_by_keyboard(visit: Visit) -> None:
    page = visit("/shapes/new", width=1440, height=900, view=False)
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
    expect(page.locator(".grid .below")).to_have_count(2)
    page.locator("#repeat").click()
    page.reload()
    expect(page.locator("#count")).to_have_text("32 modules")  # nothing painted is lost
    page.locator("#preview").click()
    page.wait_for_url(re.compile("/previews/"))
    expect(page.locator("#verdict")).to_have_text("32 cubes · 100 % like your file")
    page.go_back()
    page.locator("#undo").click()
    expect(page.locator("#count")).to_have_text("16 modules")


def test_letter_is_cut_by_dragging_and_folded(visit: Visit, service: Service) -> None:
    page = visit("/shapes/new", width=390, height=844, view=False)
    touched = "getComputedStyle(document.getElementById('grid')).touchAction"
    assert (page.evaluate(touched), page.evaluate(WIDTH) <= 390) == ("pinch-zoom", True)
    page.get_by_label("Letter L").click()
    expect(page.locator("#count")).to_have_text("72 modules")
    first = page.locator('[data-x="2"][data-y="2"]').bounding_box()
    last = page.locator('[data-x="4"][data-y="2"]').bounding_box()
    drag(page, (first["x"] + 9, first["y"] + 9), (last["x"] + 9, last["y"] + 9), steps=8)
    expect(page.locator("#count")).to_have_text("48 modules")  # a stroke from a filled cell erases
    assert overflowing(page) == {}
    own_label, blocks = (page.locator(f"label:has([value={option}])") for option in ("path", "no"))
    own_label.click()  # takes the tool that draws it
    expect(page.locator("[data-tool=path]")).to_have_attribute("aria-pressed", "true")
    blocks.click()
    page.locator("#fold").click()
    wait_for_fold(page)
    expect(page.locator("#name")).to_have_text("Letter L")
    cancel_fold(page, service)


@pytest.mark.long
def test_tools_files_and_a_drawn_path(visit: Visit, service: Service) -> None:
    page = visit("/shapes/new", width=1366, height=768, view=False)
    count = page.locator("#count")

    # The grid grows to fit a voxel file.
    voxels = np.zeros((13, 2, 1), bool)
    voxels[:, 0] = voxels[0] = True
    data = io.BytesIO()
    np.save(data, voxels)
    open_file(page, "hook.npy", data.getvalue())
    expect(count).to_have_text("112 modules")

    # Files that cannot be used are refused with the service's message; a mesh becomes as many
    # cells.
    open_file(page, "cube.npy", data.getvalue()[:-3])
    expect(page.locator("#reading")).to_contain_text("but the file has")
    open_file(page, "brick.stl", stl())
    page.locator("#mesh-cells").fill("16")
    page.locator("#mesh-cells").press("Enter")
    expect(page.locator("#reading")).to_have_text("brick.stl: 16 cells.")
    expect(count).to_have_text("128 modules")
    with page.expect_download() as download:
        page.locator("#save-cells").click()
    assert len(json.loads(download.value.path().read_text())["cells"]) == 16
    page.locator("#clear").click()
    page.locator("#name").fill("spiral")

    # A path is drawn with the keyboard and checked as it grows.
    page.locator('[data-x="5"][data-y="5"]').focus()
    page.keyboard.press("d")
    expect(page.locator('[name="exact"][value="path"]')).to_be_checked()
    keys = {(1, 0, 0): "ArrowDown", (-1, 0, 0): "ArrowUp", (0, 1, 0): "ArrowRight"}
    keys |= {(0, -1, 0): "ArrowLeft", (0, 0, 1): "PageUp", (0, 0, -1): "PageDown"}
    own_cells = [*SPIRAL, [-1, 2, 1], [-1, 1, 1]]
    steps = np.diff(np.array(own_cells), axis=0)
    page.keyboard.press("Shift+ArrowDown")  # starts at the cursor
    for step in steps.tolist():
        page.keyboard.press(f"Shift+{keys[tuple(step)]}")
    expect(count).to_have_text(f"The path visits all {len(own_cells)} cells.")
    expect(page.locator("#checked")).to_contain_text("Computing the fold takes about")
    page.keyboard.press("Backspace")
    expect(count).to_contain_text(f"{len(own_cells) - 1} of {len(own_cells)} cells")
    page.locator("#complete").click()
    expect(count).to_have_text(f"The path visits all {len(own_cells)} cells.")

    # Saved and opened again it is the same path, and that path is folded.
    with page.expect_download() as download:
        page.locator("#save-path").click()
    written = download.value.path().read_bytes()
    page.locator("#unpath").click()
    expect(count).to_contain_text("No path yet")
    open_file(page, "own.json", written)
    expect(page.locator("#reading")).to_have_text(
        f"own.json: {len(own_cells)} cells along their path."
    )
    page.locator("#fold").click()
    sent = json.loads((service.directory(wait_for_fold(page)) / "input").read_bytes())
    assert sent["format"] == "foldback-path/1"
    assert np.diff(np.array(sent["cells"]), axis=0).tolist() == steps.tolist()
    cancel_fold(page, service)
