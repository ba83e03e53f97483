"""Small frames, touch screens and the keyboard: what stays visible and what can be reached."""

from __future__ import annotations

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import AT_REST, Visit, until
from tests.server.service import Service
from tests.web.blog import Blog

MIN_PICTURE_SHARE = 0.55
"""Smallest part of the page that shows the picture, without controls on it."""
PICTURE_SHARE = """() => {
  const [step, places] = [8, []];
  for (let x = step / 2; x < innerWidth; x += step)
    for (let y = step / 2; y < innerHeight; y += step) places.push(document.elementFromPoint(x, y));
  return places.filter((one) => one?.matches("iframe, canvas, .stage")).length / places.length;
}"""
"""Part of the page where nothing lies over the picture."""
SIZES = {
    "fold": [(1366, 768), (390, 844), (640, 360), (683, 384)],
    "embed": [(640, 360), (300, 260), (300, 200)],
}
NEAREST_MODULE = """() => {
  const { player } = foldback;
  const { stage } = player.standIn;
  const { position, target } = stage.eye;
  const { field_of_view_rad: field } = stage.bundle.header.camera;
  const { left, top, width, height } = stage.frame.getBoundingClientRect();
  return {
    position, target, field, left, top, width, height,
    centres: Array.from(player.shown.positions, (v) => v * player.rig.pitch),
  };
}"""
"""The camera of the picture that is seen, the picture's place in the page, and all modules."""


def nearest_module(page: Page) -> tuple[int, float, float]:
    """Return the module nearest to the camera, which nothing hides, and its place in the page."""
    seen = page.evaluate(NEAREST_MODULE)
    eye = np.array(seen["position"])
    out = (eye - seen["target"]) / np.linalg.norm(eye - seen["target"])
    right = np.cross([0.0, 0.0, 1.0], out)
    right /= np.linalg.norm(right)
    off = np.array(seen["centres"]).reshape(-1, 3) - eye
    depth = -(off @ out)
    module = int(np.argmin(depth))
    scale = seen["height"] / 2 / np.tan(seen["field"] / 2) / depth[module]
    x = seen["left"] + seen["width"] / 2 + scale * (off[module] @ right)
    y = seen["top"] + seen["height"] / 2 - scale * (off[module] @ np.cross(out, right))
    return module, float(x), float(y)


def test_tap_selects_a_module(visit: Visit, wrench: str) -> None:
    address = f"/folds/{wrench}#frame=9999"
    page = visit(address, width=390, height=844, view=False, has_touch=True, is_mobile=True)
    page.wait_for_function("() => foldback.player.standIn.stage.eye && !foldback.player.busy")
    expect(page.locator("#keys")).to_be_hidden()  # no keyboard is there
    assert page.evaluate(PICTURE_SHARE) >= MIN_PICTURE_SHARE
    module, x, y = nearest_module(page)  # on the page's own drawing
    page.touchscreen.tap(x, y)
    assert page.evaluate("() => foldback.player.selected") == module
    page.locator("#view").evaluate("(frame) => frame.setAttribute('src', '/view')")
    page.wait_for_function("() => foldback.player.standIn.opened")
    page.locator("#drawer-close").click()
    page.evaluate(AT_REST)
    expect(page.locator("#sketch")).to_have_class("sketch gone")
    page.evaluate("() => foldback.player.select(null)")
    module, x, y = nearest_module(page)  # in the 3D view
    page.touchscreen.tap(x, y)
    page.wait_for_function(f"() => foldback.player.selected === {module}")
    page.locator("#drawer-close").click()
    # The view is one stop of the keyboard, and the page shows that it is there.
    page.locator("#ways").focus()
    page.keyboard.press("Tab")
    page.locator("#view.focused").wait_for()
    page.keyboard.press("Tab")
    expect(page.locator("#colour-by")).to_be_focused()
    expect(page.locator("#view")).not_to_have_class("focused")


@pytest.mark.parametrize("kind", SIZES)
def test_picture_fills_most_of_the_page_at_each_size(visit: Visit, wrench: str, kind: str) -> None:
    page = visit(f"/{kind}s/{wrench}" if kind == "fold" else f"/embed/{wrench}", view=False)
    expect(page.locator("#legend")).to_be_visible()
    page.locator("#cover.gone").wait_for(state="attached")  # until then it lies over the picture
    shares = {}
    for width, height in SIZES[kind]:
        page.set_viewport_size({"width": width, "height": height})
        shares[width, height] = page.evaluate(PICTURE_SHARE)
    assert {size: share for size, share in shares.items() if share < MIN_PICTURE_SHARE} == {}
    # The rest comes with a button.
    for name in ("loop", "speed", "jump", "follow", "colour-by"):
        expect(page.locator(f"#{name}")).to_be_hidden()
    page.locator("#more").click()
    expect(page.locator("#more")).to_have_attribute("aria-expanded", "true")
    for name in ("loop", "speed", "jump", "follow", "colour-by"):
        expect(page.locator(f"#{name}")).to_be_visible()
    page.locator("#more").click()
    if kind == "fold":
        for name in ("more", "details", "more"):
            page.locator(f"#{name}").click()
        drawer = page.locator("#drawer").bounding_box()
        assert drawer["width"] <= 0.5 * SIZES[kind][-1][0]
        page.locator("#drawer-close").click()
        page.set_viewport_size({"width": 1366, "height": 768})
        header = "() => document.querySelector('.top').offsetHeight"
        height = page.evaluate(header)
        page.locator("#verdict").evaluate("(verdict) => { verdict.textContent = ''; }")
        assert page.evaluate(header) == height
        page.locator(".skip").focus()
        page.keyboard.press("Enter")
        expect(page.locator("main")).to_be_focused()
        assert "#main" not in page.url


DROP = """() => {
  const dataTransfer = new DataTransfer();
  dataTransfer.items.add(new File(["1\\n2\\n"], "a.csv"));
  document.elementFromPoint(innerWidth / 2, innerHeight / 2).dispatchEvent(
    new DragEvent("drop", { dataTransfer, bubbles: true, cancelable: true }));
}"""
"""Drops a file with two numbers on what the pointer would meet in the middle of the page."""


def test_embed_zooms_after_a_click_and_takes_files(
    visit: Visit, blog: Blog, service: Service, wrench: str
) -> None:
    address = f"{service.http.base_url}/embed/{wrench}#frame=9"
    blog.html = (
        "<!doctype html><title>A blog</title><body style='height:3000px'>"
        f"<iframe src='{address}' width=400 height=300></iframe>"
    )
    reader = visit(blog.origin, width=640, height=480)
    frame = reader.frames[1]
    frame.wait_for_function("() => window.foldback?.player.standIn?.opened")
    frame.evaluate(AT_REST)
    distance = (
        "() => { const { position: p, target: t } = foldback.player.standIn.stage.eye;"
        " return Math.hypot(...p.map((v, k) => v - t[k])); }"
    )
    before = frame.evaluate(distance)
    reader.mouse.move(200, 120)
    reader.mouse.wheel(0, 200)
    reader.wait_for_function("() => scrollY === 200")
    expect(reader.frame_locator("iframe").locator("#toast")).to_contain_text("Click to zoom")
    assert frame.evaluate(distance) == before
    reader.evaluate("() => scrollTo(0, 0)")
    # A locator's click reaches the view even if the browser still takes the page for scrolled.
    view = reader.frame_locator("iframe").frame_locator("#view").locator("canvas[data-engine]")
    view.click(position={"x": 330, "y": 150})
    frame.wait_for_function("() => foldback.player.selected !== null")
    view.hover(position={"x": 190, "y": 110})

    def zoomed() -> bool:  # a browser may send one wheel too many to what scrolled last
        reader.mouse.wheel(0, -200)
        return frame.evaluate(distance) < before - 1e-6

    until(reader, zoomed)
    assert reader.evaluate("() => scrollY") == 0

    # A file that is dragged over the view is dropped on the page around it.
    view.dispatch_event("dragenter")
    expect(frame.locator("main.dropping")).to_be_visible()
    frame.evaluate(DROP)
    expect(frame.locator(".own-values [role=alert]")).to_contain_text("Got 2 rows with 1 number")
    expect(frame.locator("main.dropping")).to_have_count(0)
