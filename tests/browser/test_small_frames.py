"""Small frames, touch screens and the keyboard: controls remain visible and reachable."""

import pytest
from playwright.sync_api import expect

from tests.browser.conftest import WAIT_FOR_REST, Visit, resize, wait_until
from tests.server.service_process import Service
from tests.web.blog import Blog

MIN_PICTURE_SHARE = 0.55
"""Minimum fraction of the page that shows the picture without controls on it."""
PICTURE_SHARE = """() => {
  const [step, places] = [8, []];
  for (let x = step / 2; x < innerWidth; x += step)
    for (let y = step / 2; y < innerHeight; y += step) places.push(document.elementFromPoint(x, y));
  return places.filter((one) => one?.matches(".surface, .stage")).length / places.length;
}"""
"""Script that returns the fraction of the page where nothing covers the picture."""
MAX_LOW_HEIGHT_PX = 420
"""Height up to which a page has one row of controls over its picture."""
EDGES = """(parts) => parts.map((part) => {
  const { left, right } = part.getBoundingClientRect();
  return [Math.round(left), Math.round(right)];
})"""
"""Script that returns the left and the right edge of elements."""
SIZES = {
    "fold": [(1366, 768), (390, 844), (640, 360), (683, 384)],
    "embed": [(640, 360), (300, 260), (300, 200)],
}


@pytest.mark.parametrize("kind", SIZES)
def test_picture_fills_most_of_the_page_at_each_size(visit: Visit, wrench: str, kind: str) -> None:
    page = visit(f"/{kind}s/{wrench}" if kind == "fold" else f"/embed/{wrench}", view=False)
    expect(page.locator("#legend")).to_be_visible()
    page.locator("#cover.gone").wait_for(state="attached")  # the cover hides the picture
    shares = {}
    for width, height in SIZES[kind]:
        resize(page, width, height)
        shares[width, height] = page.evaluate(PICTURE_SHARE)
        # It shows the name, the verdict and the buttons, in one row of this order if it is low.
        edges = page.locator("#name, #verdict, #share, .whole > *").evaluate_all(EDGES)
        assert all(0 <= left_px < right <= width for left_px, right in edges), edges
        assert height > MAX_LOW_HEIGHT_PX or edges == sorted(edges)
    assert {size: share for size, share in shares.items() if share < MIN_PICTURE_SHARE} == {}
    # A button shows the rest.
    locator = page.locator("#loop, #speed, #jump, #follow, #colour-by").locator("visible=true")
    expect(locator).to_have_count(0)
    page.locator("#more").click()
    expect(page.locator("#more")).to_have_attribute("aria-expanded", "true")
    expect(locator).to_have_count(5)
    page.locator("#more").click()
    if kind == "fold":
        for name in ("more", "details", "more"):
            page.locator(f"#{name}").click()
        assert page.locator("#drawer").bounding_box()["width"] <= 0.5 * SIZES[kind][-1][0]
        page.locator("#drawer-close").click()
        resize(page, 1366, 768)
        header = "() => document.querySelector('.top').offsetHeight"
        height = page.evaluate(header)
        page.locator("#verdict").evaluate("(verdict) => { verdict.textContent = ''; }")
        assert page.evaluate(header) == height
        page.locator(".skip").focus()
        page.keyboard.press("Enter")
        expect(page.locator("main")).to_be_focused()
        assert "#main" not in page.url


@pytest.mark.parametrize("query", ["", "#play=1"])
def test_embed_plays_once_it_is_in_sight_under_compact_controls(
    visit: Visit, blog: Blog, service: Service, wrench: str, query: str
) -> None:
    address = f"{service.http.base_url}/embed/{wrench}{query}"
    blog.html = (
        "<!doctype html><title>A blog</title><body style='padding-top: 640px'>"
        f"<iframe src='{address}' width=700 height=467></iframe>"
    )
    reader = visit(blog.origin, width=760, height=700, view=False, reduced_motion="no-preference")
    frame = reader.frames[1]
    # Only its upper edge is in sight.
    frame.locator("#cover.gone").wait_for(state="attached")
    reader.wait_for_timeout(300)
    assert frame.evaluate("() => foldback.player.playhead.frame") == 0
    reader.evaluate("() => scrollTo(0, 400)")
    frame.wait_for_function("() => foldback.player.playhead.frame > 0")
    controls = frame.locator("#bar :is(button, input, select):visible")
    assert controls.evaluate_all("all => all.map(({ id }) => id)") == ["scrub", "play", "more"]


DRAG = """(kind) => {
  const dataTransfer = new DataTransfer();
  dataTransfer.items.add(new File(["1\\n2\\n"], "a.csv"));
  document.elementFromPoint(innerWidth / 2, innerHeight / 2).dispatchEvent(
    new DragEvent(kind, { dataTransfer, bubbles: true, cancelable: true }));
}"""
"""Drags a file with two numbers over the element in the middle of the page, or drops it there."""


def test_embed_zooms_after_a_click_and_accepts_dropped_files(
    visit: Visit, blog: Blog, service: Service, wrench: str
) -> None:
    address = f"{service.http.base_url}/embed/{wrench}#frame=9"
    blog.html = (
        "<!doctype html><title>A blog</title><body style='height:3000px'>"
        f"<iframe src='{address}' width=400 height=300></iframe>"
    )
    reader = visit(blog.origin, width=640, height=480)
    frame = reader.frames[1]
    frame.wait_for_function("() => window.foldback?.player.standIn?.state.is === 'viewing'")
    frame.evaluate(WAIT_FOR_REST)
    distance = (
        "() => { const { position: p, target: t } = foldback.player.standIn.stage.eye;"
        " return Math.hypot(...p.map((v, k) => v - t[k])); }"
    )
    before = frame.evaluate(distance)
    reader.mouse.move(200, 120)
    reader.mouse.wheel(0, 200)
    reader.wait_for_function("() => scrollY === 200")
    expect(reader.frame_locator("iframe").locator("#toast")).to_contain_text("To zoom, click here")
    assert frame.evaluate(distance) == before
    reader.evaluate("() => scrollTo(0, 0)")
    # A locator clicks into the view even while the browser still treats the page as scrolled.
    view = reader.frame_locator("iframe").locator(".surface")
    view.click(position={"x": 330, "y": 150})
    frame.wait_for_function("() => foldback.player.selected !== null")
    view.hover(position={"x": 190, "y": 110})

    def zoomed() -> bool:  # the first wheel event may go to the element that scrolled last
        reader.mouse.wheel(0, -200)
        return frame.evaluate(distance) < before - 1e-6

    wait_until(reader, zoomed)
    assert reader.evaluate("() => scrollY") == 0

    # A file that is dragged over the view is dropped on the page around it.
    frame.evaluate(DRAG, "dragenter")
    expect(frame.locator("main.dropping")).to_be_visible()
    frame.evaluate(DRAG, "drop")
    expect(frame.locator(".own-values [role=alert]")).to_contain_text("has 2 rows with 1 number")
    expect(frame.locator("main.dropping")).to_have_count(0)
