"""The pages as a visitor meets them: a real service, a real browser."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, Route, expect

from planner.motion.timeline import Timeline
from planner.progress import COMPILING
from tests.browser.conftest import (
    NO_WEBGL,
    PATIENCE_MS,
    WIDTH,
    Visit,
    at_frame,
    choose,
    opened_fold,
    path_file,
    picture,
    seek,
    shot,
    shown_frame,
)
from tests.server.service import STAIRS, Service
from web.pictures.colours import error_scale, module_errors
from web.timeline.view import TimelineView

SMALL = {"width": 480, "height": 400}
"""Window size in pixels that software rendering paints quickly."""

SHAPE = Path(__file__).parents[2] / "examples" / "shapes" / "wrench-24.json"
DROP = """([text, name]) => {
  const files = new DataTransfer();
  files.items.add(new File([text], name, { type: "application/json" }));
  const zone = document.getElementById("drop");
  for (const kind of ["dragenter", "dragover", "drop"])
    zone.dispatchEvent(
      new DragEvent(kind, { dataTransfer: files, bubbles: true, cancelable: true }));
}"""


def dropped(page: Page, text: str, name: str = "wrench.json") -> None:
    page.evaluate(DROP, [text, name])


def redness(image: np.ndarray) -> float:
    """How much redder than grey the picture is, summed over its pixels."""
    red = image[..., 0] - image[..., 1:].mean(axis=-1)
    return float(np.clip(red - 4.0, 0.0, None).sum())


def area(image: np.ndarray) -> float:
    """Pixels that show modules."""
    return float((image.mean(axis=-1) > 70).sum())


def solid_spot(image: np.ndarray) -> tuple[int, int]:
    """A place (x, y) well inside a module, near the middle of the chain."""
    bright = image.mean(axis=-1) > 70
    inside = bright.copy()
    for axis in (0, 1):
        for by in (-3, 3):
            inside &= np.roll(bright, by, axis)
    ys, xs = np.nonzero(inside)
    assert len(xs), "no module is to be seen"
    nearest = np.argmin((xs - xs.mean()) ** 2 + (ys - ys.mean()) ** 2)
    return int(xs[nearest]), int(ys[nearest])


@pytest.mark.long
def test_page_polls_when_its_event_stream_is_refused(visit: Visit) -> None:
    page = visit("/", view=False)
    exploding = {"status": "running", "stage": "explode", "fraction": 0.4, "steps": 1200}
    exploding |= {"steps_per_second": 100, "simulated_s": 12.2}
    compiling = {"status": "running", "stage": "read", "message": COMPILING, "fraction": 0.425}
    preparing = {"fraction": 0.61, "remaining_s": 24}
    queued = {"status": "queued", "stage": None, "queue_position": 2, "preparing": preparing}
    told = [compiling, queued, exploding]

    def answer(route: Route) -> None:
        if told:
            route.fulfill(json={"progress": told[0]})
        else:
            route.continue_()

    def no_frames_yet(route: Route) -> None:
        if len(told) > 1:
            route.fulfill(status=204)
        else:
            route.continue_()

    page.route("**/folds/*/batch?*", no_frames_yet)
    page.route("**/api/folds/*/events", lambda route: route.fulfill(status=429))
    page.route(re.compile(r"/api/folds/[a-z0-9]+$"), answer)
    choose(page, "stairs.json", path_file(STAIRS))
    expect(page.locator("#verdict")).to_have_text(
        "First start: preparing the solvers, 42 % done. This happens only once"
    )
    told.pop(0)
    expect(page.locator("#verdict")).to_have_text(
        "First start: preparing the solvers, 61 % done. This happens only once · about 25 s left "
        "· then behind 1 other fold"
    )
    expect(page.get_by_role("progressbar", name="Preparing the solvers")).to_have_attribute(
        "aria-valuenow", "61"
    )
    told.pop(0)
    expect(page.locator("#verdict")).to_have_text(
        re.compile(r" 40 % · 1.?200 steps · 12 s simulated$")
    )
    told.pop(0)
    expect(page.locator("#verdict")).to_have_text(re.compile("^Verified"))
    expect(page.locator("#progress")).to_be_hidden()


@pytest.mark.parametrize("view", [False, pytest.param(True, marks=pytest.mark.long)])
def test_dropped_file_folds_and_is_inspected(visit: Visit, service: Service, view: bool) -> None:
    page = visit("/", height=480, view=view)
    path = json.loads(SHAPE.read_text()) | {"name": "dropped wrench"}
    dropped(page, json.dumps(path))

    fold_id = opened_fold(page)
    expect(page.locator("#verdict")).to_have_text(
        re.compile(
            r"^Verified \(simulated\): modules stay at least \d+\.\d % .* apart · 24 modules$"
        )
    )
    expect(page.locator("#name")).to_have_text("dropped wrench")
    if view:  # else the page's own drawing stays, in the same colours
        page.locator("#sketch.gone").wait_for(state="attached")
    assert "#" not in page.url  # nothing was done yet that a link should tell of
    timeline = Timeline.open(service.directory(fold_id) / "timeline.zarr")
    frames, chain = timeline.frames(), timeline.chain
    film = TimelineView(timeline.path)

    # Scrub: the picture is as red as the recorded error says.
    errors = module_errors(
        frames.joint_error_rad,
        len(chain),
        hinges=chain.module.hinges_per_joint,
        rigid_links=chain.module.rigid_links,
    )
    scale = error_scale(float(np.nanmax(errors)))
    shares = np.nan_to_num(errors / scale).mean(axis=1)
    explosion = int(np.flatnonzero(frames.phase == 0)[len(frames) // 8])
    assert shares[explosion] == 0.0
    low = int(np.flatnonzero(frames.phase == 1)[0])
    high = int(np.argmax(shares))
    measured: dict[int, float] = {}
    for frame in (explosion, low, high):
        seek(page, frame)
        seen = picture(page)
        measured[frame] = redness(seen) / area(seen)
    assert measured[explosion] == 0.0
    assert measured[low] < measured[high]
    expect(page.locator("#r-error")).to_have_text(
        re.compile(rf"Error {float(f'{1e6 * np.nanmax(errors[high]):.2g}'):g} µrad")
    )

    # Step, by button and by key, with the focus in the page or in the view.
    page.locator("#back").click()
    at_frame(page, high - 1)
    for key, frame in (("ArrowRight", high), ("Home", 0), ("End", len(frames) - 1)):
        page.keyboard.press(key)
        at_frame(page, frame)

    # Click a module: what is said of it is what was recorded.
    seek(page, explosion)
    x, y = solid_spot(picture(page))
    page.locator("main.stage").click(position={"x": x, "y": y})
    heading = page.locator("#panel-module h2")
    expect(heading).to_contain_text("Module")
    index = int(re.findall(r"\d+", heading.inner_text())[0]) - 1
    cell = np.rint(chain.folded_poses.positions[index]).astype(int)
    said = page.locator("#panel-module dd").nth(1).inner_text().replace("−", "-")
    assert [int(c) for c in said.split(", ")] == cell.tolist()
    first = (index - 1) * 2
    rows = page.locator("#panel-module .joints tr[data-joint]")
    if 0 < index < len(chain) - 1:
        expect(rows).to_have_count(2)
        for k in range(2):
            now = rows.nth(k).locator("[data-of=now]").inner_text()
            angle = np.rad2deg(frames.joint_angles_rad[explosion, first + k])
            assert float(now.rstrip("°").replace("−", "-")) == pytest.approx(angle, abs=0.051)
    seen = picture(page)
    assert (seen[..., 2] - seen[..., 0]).max() > 60  # it is blue
    page.keyboard.press("ArrowRight")  # the focus is in the view now
    assert shown_frame(page) >= explosion
    at_frame(page, explosion + 1)

    # Properties and downloads.
    page.locator("#tab-properties").click()
    expect(page.locator("#panel-properties")).to_contain_text("Least clearance")
    page.locator("#tab-downloads").click()
    with page.expect_download() as download:
        page.locator("#panel-downloads a").first.click()
    plan = json.loads(Path(download.value.path()).read_text())
    assert plan["format"] == "foldback-plan/3"
    assert len(film) == len(frames)


@pytest.mark.long
def test_fold_plays_by_itself_and_the_camera_follows(visit: Visit, wrench: str) -> None:
    page = visit(f"/folds/{wrench}", reduced_motion="no-preference", **SMALL)
    expect(page.locator("#play")).to_have_attribute("aria-label", "Pause")
    first = shown_frame(page)
    expect(page.locator("#r-frame")).not_to_have_text(re.compile(f"Frame {first + 1} of"))
    page.keyboard.press(" ")
    expect(page.locator("#play")).to_have_attribute("aria-label", "Play")
    expect(page.locator("#follow")).to_have_attribute("aria-pressed", "true")
    page.locator("#sketch.gone").wait_for(state="attached")
    box = page.locator("main.stage").bounding_box()
    page.mouse.move(box["x"] + 200, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] + 280, box["y"] + box["height"] / 2 + 20, steps=4)
    page.mouse.up()
    page.wait_for_url(re.compile("camera="))
    expect(page.locator("#follow")).to_have_attribute("aria-pressed", "true")


def test_reload_and_link_show_the_same_frame_and_module(visit: Visit, wrench: str) -> None:
    page = visit(f"/folds/{wrench}", view=False, **SMALL)
    seek(page, 30)
    page.wait_for_url("**/folds/*#frame=31")
    page.evaluate("() => window.foldback.player.send({ do: 'select', module: 3 })")
    page.wait_for_url("**/folds/*#frame=31&module=4")
    page.reload()
    at_frame(page, 30)
    expect(page.locator("#panel-module h2")).to_contain_text("Module 4")
    link, moving = f"/folds/{wrench}#frame=12&module=4", {"reduced_motion": "no-preference"}
    other = visit(link, view=False, **SMALL, **moving)
    at_frame(other, 11)
    expect(other.locator("#panel-module h2")).to_contain_text("Module 4")
    seek(other, 20)
    at_frame(page, 30)  # each visitor has a playhead


WHOLE = """text => text.scrollWidth <= text.clientWidth && text.scrollHeight <= text.clientHeight
  && text.getBoundingClientRect().right <= innerWidth"""
"""JavaScript function that returns true if no part of a text is cut off."""


@pytest.mark.long
def test_landing_and_fold_fit_a_phone(visit: Visit, wrench: str) -> None:
    page = visit("/", width=390, height=844, has_touch=True, view=False)
    assert page.evaluate(WIDTH) <= 390
    page.goto(f"/folds/{wrench}")
    page.locator("#cover.gone").wait_for(state="attached")
    page.keyboard.press("End")
    picture(page)
    assert page.evaluate(WIDTH) <= 390
    for width in (360, 390):
        page.set_viewport_size({"width": width, "height": 844})
        assert page.locator("#verdict").evaluate(WHOLE)
    page.locator("#details").tap()
    sheet = page.locator("#drawer").bounding_box()
    bar = page.locator("#bar").bounding_box()
    assert sheet["width"] == 390
    assert sheet["y"] > 300  # the view keeps the upper part
    assert sheet["y"] + sheet["height"] <= bar["y"] + 1
    assert bar["y"] + bar["height"] <= 844


HELD = """if (self !== top) {
  const next = requestAnimationFrame.bind(window);
  let held = [];
  window.requestAnimationFrame = (then) => (held ? held.push(then) : next(then));
  window.release = () => { const all = held; held = null; all.forEach(next); };
}"""
"""The view of a browser that takes its time for pictures."""
PASSED = """async () => {
  for (let k = 0; k < 40; k++) await new Promise(requestAnimationFrame);
}"""


@pytest.mark.long
def test_drawing_stays_until_the_3d_view_has_painted(visit: Visit, wrench: str) -> None:
    page = visit(f"/folds/{wrench}", width=390, height=520, has_touch=True, script=HELD)
    page.wait_for_function("() => window.foldback.player.stage.open")
    page.keyboard.press("End")
    page.evaluate(PASSED)
    expect(page.locator("#sketch")).not_to_have_class(re.compile("gone"))
    page.frames[1].evaluate("() => release()")
    page.locator("#sketch.gone").wait_for(state="attached")
    assert (picture(page).mean(axis=-1) > 90).sum() > 500


SLOW = """if (self !== top) {
  const next = requestAnimationFrame.bind(window);
  let wait = 0;
  window.requestAnimationFrame = (then) => wait ? setTimeout(() => next(then), wait) : next(then);
  const every = setInterval;
  let beats = true;
  window.setInterval = (then, ms) => every(() => { if (beats) then(); }, ms);
  window.tire = () => { wait = 400; beats = false; };
}"""
"""A view that, once tired, takes long for a picture and paints none that nobody asked for."""
REST_MS = 2000
"""More than after what the view rests: see bridge.js."""


@pytest.mark.long
def test_resting_view_wakes_for_the_next_frame_on_a_slow_machine(visit: Visit, wrench: str) -> None:
    # A lower window hides the controls.
    page = visit(f"/folds/{wrench}", width=640, height=440, script=SLOW)
    page.locator("#sketch.gone").wait_for(state="attached")
    seek(page, 0)
    folded = picture(page)
    page.add_style_tag(content="#sketch { display: none }")  # it would stand in for the view
    page.locator("#follow").click()  # a camera that moves would have it paint on
    page.frames[1].evaluate("() => tire()")
    page.wait_for_timeout(REST_MS)
    page.locator("#jump").select_option("straight")
    expect(page.locator("#r-folded")).to_have_text("0 %")
    deadline = time.monotonic() + PATIENCE_MS / 1000
    while np.abs(shot(page) - folded).max() <= 50:
        assert time.monotonic() < deadline, "the view goes on showing what was there before"
        page.wait_for_timeout(200)


def test_bad_file_and_unknown_fold_are_explained(visit: Visit) -> None:
    page = visit("/", view=False)
    dropped(page, json.dumps([[0, 0, 0], [1, 0, 0], [0, 0, 0]]), "bad.json")
    expect(page.locator("#drop-message")).to_contain_text("Cells 1 and 3")
    assert page.url.endswith("/")
    for kind, heading in (("folds", "Fold not found"), ("previews", "This preview has expired")):
        page.goto(f"/{kind}/nosuchone")
        expect(page.locator("h1")).to_have_text(heading)


def test_fold_without_webgl_is_drawn_by_the_page(visit: Visit, wrench: str) -> None:
    page = visit(f"/folds/{wrench}", script=NO_WEBGL, **SMALL)
    expect(page.locator("#flat")).to_contain_text("WebGL is missing")
    page.locator("#cover.gone").wait_for(state="attached")
    assert page.locator("#view").get_attribute("src") is None
    seek(page, 0)
    folded = picture(page)
    page.keyboard.press("End")
    expect(page.locator("#r-phase")).to_have_text("Playback")
    seek(page, 60)
    assert np.abs(picture(page) - folded).max() > 50
